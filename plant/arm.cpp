#include "plant/arm.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <tuple>
#include <utility>

#include "diagnostics/text.h"
#include "plant/arm_mechanics.h"
#include "plant/encoder.h"
#include "robot/kinematics.h"

namespace tachless::plant {
namespace {

constexpr double never = std::numeric_limits<double>::infinity();
/// Of the encoders' noise, other channels.
constexpr std::uint32_t noise_channel = 16;

void require_size(const robot::Vector& x, Eigen::Index num_joints) {
  if (x.size() != num_joints) throw std::logic_error("plant::Arm: wrong number of joints");
}

Coordinates joined(const robot::Vector& of_links, const robot::Vector& of_motors) {
  Coordinates all(of_links.size() + of_motors.size());
  all << of_links, of_motors;
  return all;
}

}  // namespace

Disturbances::Disturbances(const std::vector<DisturbanceSpec>& specs, double period_s,
                           const robot::Model& model)
    : model_(model), period_s_(period_s) {
  for (const DisturbanceSpec& spec : specs) {
    const auto& names = model.joint_names;
    const auto joint = std::find(names.begin(), names.end(), spec.joint) - names.begin();
    sources_.push_back({&spec, spec.joint.empty() ? -1 : static_cast<int>(joint)});
  }
}

double Disturbances::next_jump(double from_s, double until_s) const {
  // Start and end are sums of decimals as ticks are: what is nearer than that is the same.
  const double same_s = 1e-9 * period_s_;
  double next_s = until_s;
  for (const Source& source : sources_) {
    for (const double jump_s : {source.spec->start_s, source.spec->end_s.value_or(never)}) {
      if (jump_s > from_s + same_s && jump_s < next_s - same_s) next_s = jump_s;
    }
  }
  return next_s;
}

void Disturbances::choose(double from_s, double until_s) {
  const double middle_s = from_s + (until_s - from_s) / 2;
  const auto tick = static_cast<std::int64_t>(middle_s / period_s_);
  for (std::size_t i = 0; i < sources_.size(); ++i) {
    Source& source = sources_[i];
    const DisturbanceSpec& spec = *source.spec;
    source.active = spec.start_s <= middle_s && middle_s < spec.end_s.value_or(never);
    if (!source.active || spec.shape != DisturbanceShape::noise) continue;
    source.noise = standard_normal(spec.seed, tick, noise_channel, static_cast<std::uint32_t>(i));
  }
}

void Disturbances::add(double time_s, const double* q, robot::Vector& tau) const {
  using std::numbers::pi;
  for (const Source& source : sources_) {
    if (!source.active) continue;
    const DisturbanceSpec& spec = *source.spec;
    const double since_s = time_s - spec.start_s;
    double value = 1;
    switch (spec.shape) {
      case DisturbanceShape::constant:
        break;
      case DisturbanceShape::pulse:
        value = std::sin(pi * since_s / (*spec.end_s - spec.start_s));
        break;
      case DisturbanceShape::sinusoid:
        value = std::sin(2 * pi * spec.frequency_hz * since_s + spec.phase_rad);
        break;
      case DisturbanceShape::noise:
        value = source.noise;
        break;
    }
    if (source.joint >= 0) {
      tau[source.joint] += value * *spec.torque_Nm;
      continue;
    }
    const Eigen::Vector3d point(spec.point_m.data()), force(spec.force_N->data());
    tau += robot::force_torque(model_, model_.frames.at(spec.link), point, value * force,
                               Eigen::Map<const robot::Vector>(q, model_.num_joints));
  }
}

robot::Vector Disturbances::at(double time_s, const robot::Vector& q) {
  choose(time_s, next_jump(time_s, time_s + period_s_));
  robot::Vector tau = robot::Vector::Zero(model_.num_joints);
  add(time_s, q.data(), tau);
  return tau;
}

ArmMechanics::ArmMechanics(const robot::Model& model, const ArmOptions& options,
                           const ArmState& initial)
    : tau(robot::Vector::Zero(model.num_joints)),
      x(joined(initial.q, initial.theta)),
      xdot(joined(initial.v, initial.thetadot)),
      now_s(options.start_s),
      flexible_(options.flexible != nullptr),
      disturbances_(options.disturbances) {
  const int n = model.num_joints;
  const auto or_zero = [&](const robot::Vector& given) { return given.size() == 0 ? tau : given; };
  rigid_rotor_inertia_ = or_zero(model.rotor_inertia);
  friction_ = or_zero(options.drive.viscous_friction_Nms_per_rad);
  require_size(rigid_rotor_inertia_, n);
  require_size(friction_, n);
  if (!flexible_) return;
  K_ = options.flexible->stiffness;
  J_ = options.flexible->rotor_inertia;
  motor_damping_ = or_zero(options.flexible->motor_damping);
  if (K_.size() != n || J_.size() != n || motor_damping_.size() != n || !(J_.array() > 0).all()) {
    throw std::logic_error("plant::Arm: flexible joints need K, J > 0 and damping per joint");
  }
}

void ArmMechanics::accelerate(double time_s, const double* at_x, const double* at_xdot,
                              double* xddot) {
  const Eigen::Index n = tau.size();
  const Links links = evaluate(at_x, at_xdot);
  rhs_ = -links.bias;
  for (Eigen::Index i = 0; i < n; ++i) {
    links.M(i, i) += rigid_rotor_inertia_[i];
    rhs_[i] -= friction_[i] * at_xdot[i];
    if (flexible_) {
      const double spring = K_[i] * (at_x[n + i] - at_x[i]);
      rhs_[i] += spring;
      xddot[n + i] = (tau[i] - spring - motor_damping_[i] * at_xdot[n + i]) / J_[i];
    } else {
      rhs_[i] += tau[i];
    }
  }
  if (disturbances_ != nullptr) disturbances_->add(time_s, at_x, rhs_);
  solve(at_xdot, rhs_);
  for (Eigen::Index i = 0; i < n; ++i) xddot[i] = rhs_[i];
}

Coordinates ArmMechanics::acceleration() {
  Coordinates xddot(x.size());
  accelerate(now_s, x.data(), xdot.data(), xddot.data());
  return xddot;
}

Arm::Arm(const robot::Model& model, const ArmOptions& options, const ArmState& initial)
    : state_(initial), disturbances_(options.disturbances) {
  const int num_motors = options.flexible != nullptr ? model.num_joints : 0;
  if (initial.q.size() != model.num_joints || initial.v.size() != model.num_joints ||
      initial.theta.size() != num_motors || initial.thetadot.size() != num_motors) {
    throw std::logic_error("plant::Arm: initial state has the wrong number of joints");
  }
  mechanics_ = options.mechanics == Mechanics::native ? native_arm(model, options, initial)
                                                      : simbody_arm(model, options, initial);
}
Arm::~Arm() = default;
Arm::Arm(Arm&&) noexcept = default;
Arm& Arm::operator=(Arm&&) noexcept = default;

std::int64_t Arm::integrator_steps() const { return mechanics_->steps(); }

ArmAcceleration Arm::acceleration(const robot::Vector& tau) const {
  require_size(tau, state_.q.size());
  const robot::Vector held = std::exchange(mechanics_->tau, tau);
  const Coordinates xddot = mechanics_->acceleration();
  mechanics_->tau = held;
  return {xddot.head(state_.q.size()), xddot.tail(state_.theta.size())};
}

void Arm::advance(const robot::Vector& tau, double time_s) {
  require_size(tau, state_.q.size());
  const double from_s = mechanics_->now_s;
  if (!(time_s > from_s)) throw std::logic_error("plant::Arm: time must move forward");
  mechanics_->tau = tau;
  try {
    while (mechanics_->now_s < time_s) {
      double end_s = time_s;
      if (disturbances_ != nullptr) {
        end_s = disturbances_->next_jump(mechanics_->now_s, time_s);
        disturbances_->choose(mechanics_->now_s, end_s);
      }
      mechanics_->advance(end_s);
    }
    const auto& [x, xdot] = std::tie(mechanics_->x, mechanics_->xdot);
    state_.q = x.head(state_.q.size());
    state_.v = xdot.head(state_.q.size());
    state_.theta = x.tail(state_.theta.size());
    state_.thetadot = xdot.tail(state_.theta.size());
    if (!(x.allFinite() && xdot.allFinite())) throw std::runtime_error("the state is not finite");
  } catch (const std::logic_error&) {
    throw;
  } catch (const std::exception& error) {
    // Simbody's messages have several lines.
    throw std::runtime_error(fmt::format(
        "the plant cannot be integrated on from t = {:g} s: {}; shorten loop.period_s, loosen "
        "plant.integrator.accuracy, or look for a torque, stiffness or speed that is out of "
        "proportion",
        from_s, diagnostics::one_line(error.what())));
  }
}

void Arm::brake(const robot::Vector& damping) {
  require_size(damping, state_.q.size());
  mechanics_->brake(damping);
}

}  // namespace tachless::plant

#include "plant/arm.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "base/elementary.h"
#include "base/text.h"
#include "plant/step_error.h"

namespace tachless::plant {
namespace {

/// Merson's method with its error estimate (Hairer, Norsett, Wanner, Solving ODEs I, II.4):
/// k_i = f(y + h sum_j a_ij k_j), y+ = y + h sum_i b_i k_i, error = h sum_i e_i k_i = O(h^5).
constexpr int error_order = 5;
constexpr double a[5][4] = {
    {}, {1. / 3}, {1. / 6, 1. / 6}, {1. / 8, 0, 3. / 8}, {1. / 2, 0, -3. / 2, 2}};
constexpr double b[5] = {1. / 6, 0, 0, 4. / 6, 1. / 6};
// A fifth of the difference to the last stage's argument.
constexpr double e[5] = {(1. / 6 - 1. / 2) / 5, 0, (3. / 2) / 5, (4. / 6 - 2) / 5, (1. / 6) / 5};

/// Largest ratio of a step's length to that of the step before.
constexpr double max_growth = 5;
/// Most steps between two jumps of a torque; a loop that needs more is out of proportion.
constexpr int max_steps = 20000;

void require_size(const Vector& x, Eigen::Index num_joints) {
  if (x.size() != num_joints) throw std::logic_error("plant::Arm: wrong number of joints");
}

DryFriction friction_of(const DriveSpec& drive) {
  if (!drive.dry_friction()) return {};
  std::vector<robot::JointFriction> joints;
  for (Eigen::Index i = 0; i < drive.coulomb_friction_Nm.size(); ++i) {
    joints.push_back(drive.friction_of(i));
  }
  return DryFriction(std::move(joints));
}

}  // namespace

Arm::Arm(const robot::Model& model, const ArmOptions& options, const ArmState& initial)
    : num_joints_(model.num_joints),
      accuracy_(options.accuracy),
      flexible_(options.flexible != nullptr),
      torque_scale_(options.drive.torque_scale),
      torque_offset_(options.drive.torque_offset_Nm),
      dry_friction_(friction_of(options.drive)),
      disturbances_(options.disturbances),
      tau_(Vector::Zero(model.num_joints)),
      lag_(initial.torque) {
  const Eigen::Index n = num_joints_, num_motors = flexible_ ? n : 0;
  require_size(initial.q, n);
  require_size(initial.v, n);
  require_size(initial.theta, num_motors);
  require_size(initial.thetadot, num_motors);
  const auto or_zero = [&](const Vector& given) { return given.size() == 0 ? tau_ : given; };
  rigid_rotor_inertia_ = or_zero(model.rotor_inertia);
  viscous_friction_ = or_zero(options.drive.viscous_friction_Nms_per_rad);
  require_size(rigid_rotor_inertia_, n);
  require_size(viscous_friction_, n);
  current_rate_ = tau_;
  if (const auto& hz = options.drive.current_loop_hz) current_rate_ = 2 * std::numbers::pi * *hz;
  if (torque_scale_.size() == 0) torque_scale_ = Vector::Ones(n);
  torque_offset_ = or_zero(torque_offset_);
  lag_ = or_zero(lag_);
  require_size(current_rate_, n);
  require_size(torque_scale_, n);
  require_size(torque_offset_, n);
  require_size(lag_, n);
  if (flexible_) {
    K_ = options.flexible->stiffness;
    J_ = options.flexible->rotor_inertia;
    motor_damping_ = or_zero(options.flexible->motor_damping);
    spring_damping_ = or_zero(options.flexible->spring_damping);
    if (K_.size() != n || J_.size() != n || motor_damping_.size() != n ||
        spring_damping_.size() != n || !(J_.array() > 0).all()) {
      throw std::logic_error("plant::Arm: flexible joints need K, J > 0 and damping per joint");
    }
    const Vector dry = or_zero(options.flexible->motor_coulomb_friction_Nm);
    if ((dry.array() > 0).any()) {
      std::vector<robot::JointFriction> motors;
      for (const double each : dry) motors.push_back({each, each});
      motor_friction_ = DryFriction(std::move(motors));
    }
  }
  x_.resize(n + num_motors);
  x_ << initial.q, initial.theta;
  xdot_.resize(x_.size());
  xdot_ << initial.v, initial.thetadot;
  xddot_.resize(x_.size());
  rate_.fill(xddot_);
  acceleration_.fill(xddot_);
  links_ =
      options.mechanics == Mechanics::native ? native_multibody(model) : simbody_multibody(model);
}

ArmState Arm::state() const {
  const Eigen::Index num_motors = x_.size() - num_joints_;
  ArmState state{x_.head(num_joints_), xdot_.head(num_joints_), x_.tail(num_motors),
                 xdot_.tail(num_motors)};
  if (current_rate_.isZero(0)) return state;
  state.torque = tau_;
  for (Eigen::Index i = 0; i < num_joints_; ++i) state.torque[i] = torque(i, now_s_);
  return state;
}

double Arm::torque(Eigen::Index joint, double time_s) const {
  const double rate = current_rate_[joint];
  return rate == 0 ? tau_[joint]
                   : tau_[joint] + lag_[joint] * base::exp(-rate * (time_s - since_s_));
}

void Arm::set_state(const ArmState& state, double time_s) {
  x_ << state.q, state.theta;
  xdot_ << state.v, state.thetadot;
  tau_.setZero();
  lag_ = state.torque.size() > 0 ? state.torque : tau_;
  since_s_ = now_s_ = time_s;
  step_s_ = 0;
}

/// Computes the accelerations of (q, theta) at a time, a position and a velocity.
void Arm::accelerate(double time_s, const Coordinates& x, const Coordinates& xdot,
                     Coordinates& xddot) {
  const Eigen::Index n = num_joints_;
  q_ = x.head(n);
  v_ = xdot.head(n);
  const bool loaded = dry_friction_.needs_gravity();
  if (loaded) gravity_ = links_->evaluate(q_, Vector::Zero(n)).bias;
  const Multibody::Terms links = links_->evaluate(q_, v_);
  load_ = -links.bias;
  for (Eigen::Index i = 0; i < n; ++i) {
    links.M(i, i) += rigid_rotor_inertia_[i];
    load_[i] -= viscous_friction_[i] * v_[i];
    const double drive = torque_scale_[i] * torque(i, time_s) + torque_offset_[i];
    if (flexible_) {
      double spring = K_[i] * (x[n + i] - q_[i]);
      if (spring_damping_[i] > 0) spring += spring_damping_[i] * (xdot[n + i] - v_[i]);
      load_[i] += spring;
      xddot[n + i] = (drive - spring - motor_damping_[i] * xdot[n + i]) / J_[i];
    } else {
      load_[i] += drive;
    }
  }
  if (disturbances_ != nullptr) disturbances_->add(time_s, q_, load_);
  dry_friction_.solve(links.M, v_.data(), loaded ? gravity_.data() : nullptr, load_);
  xddot.head(n) = load_;
  if (!motor_friction_.present()) return;
  load_ = xddot.tail(n).cwiseProduct(J_);
  Matrix J = J_.asDiagonal();
  motor_friction_.solve(J, xdot.data() + n, nullptr, load_);
  xddot.tail(n) = load_;
}

/// Decides which joints stick from now on.
void Arm::choose_sticking() {
  if (!dry_friction_.present() && !motor_friction_.present()) return;
  dry_friction_.stick(xdot_.data());
  motor_friction_.stick(xdot_.data() + num_joints_);
  accelerate(now_s_, x_, xdot_, xddot_);
  dry_friction_.release();
  motor_friction_.release();
}

void Arm::advance(const Vector& tau, double time_s) {
  require_size(tau, num_joints_);
  const double from_s = now_s_;
  if (!(time_s > from_s)) throw std::logic_error("plant::Arm: time must move forward");
  for (Eigen::Index i = 0; i < num_joints_; ++i) lag_[i] = torque(i, now_s_) - tau[i];
  tau_ = tau;
  since_s_ = now_s_;
  try {
    while (now_s_ < time_s) {
      double end_s = time_s;
      if (disturbances_ != nullptr) {
        end_s = disturbances_->next_jump(now_s_, time_s);
        disturbances_->choose(now_s_, end_s);
      }
      integrate(end_s);
    }
    if (!(x_.allFinite() && xdot_.allFinite())) throw std::runtime_error("the state is not finite");
  } catch (const std::logic_error&) {
    throw;
  } catch (const std::exception& error) {
    // Simbody's messages have several lines.
    throw std::runtime_error(fmt::format(
        "the plant cannot be integrated on from t = {:g} s: {}; shorten loop.period_s, loosen "
        "plant.integrator.accuracy, or look for a torque, stiffness or speed that is out of "
        "proportion",
        from_s, base::one_line(error.what())));
  }
}

/// Integrates to `end_s`; no torque jumps before that.
void Arm::integrate(double end_s) {
  if (step_s_ == 0) step_s_ = end_s - now_s_;
  choose_sticking();
  for (int taken = 0; now_s_ < end_s; ++taken) {
    if (taken >= max_steps) {
      throw std::runtime_error(fmt::format("more than {} integrator steps", max_steps));
    }
    take_step(end_s);
  }
}

/// Takes or refuses one step, to `end_s` at most.
void Arm::take_step(double end_s) {
  // The interval's end may cut a step short; step_s_ then keeps its value.
  const bool last = now_s_ + step_s_ * (1 + 1e-12) >= end_s;
  const double h = last ? end_s - now_s_ : step_s_;
  if (!(now_s_ + h > now_s_)) {
    throw std::runtime_error("the accuracy cannot be reached with any step");
  }
  const double error = try_step(h);
  // A step whose error is not a number is refused like one that is too long.
  const bool accepted = error <= accuracy_;
  const double factor = error > 0 || !std::isfinite(error)
                            ? 0.9 * base::pow(accuracy_ / error, 1.0 / error_order)
                            : max_growth;
  const double wanted = h * (std::isfinite(factor) ? std::clamp(factor, 0.1, max_growth) : 0.1);
  if (!accepted) {
    step_s_ = wanted;
    return;
  }
  if (!last || wanted > step_s_ || wanted < h) step_s_ = wanted;
  const std::optional<double> change_s = shorten_to_change(h);
  const double taken = change_s.value_or(h);
  x_ = next_x_;
  xdot_ = next_xdot_;
  now_s_ = last && taken == h ? end_s : now_s_ + taken;
  if (!change_s) return;
  dry_friction_.stop(xdot_.data());
  motor_friction_.stop(xdot_.data() + num_joints_);
  choose_sticking();
}

/// Shortens the step of length h, in next_x_ and next_xdot_, to just after the first instant at
/// which a joint begins to stick or to slide, and returns the shorter length. Returns nothing if
/// there is none. The bracket is halved at least every third time, so it always closes.
std::optional<double> Arm::shorten_to_change(double h) {
  if (!dry_friction_.present() && !motor_friction_.present()) return {};
  const auto violation = [this](double step_s) {
    if (dry_friction_.sticks() || motor_friction_.sticks()) {
      accelerate(now_s_ + step_s, next_x_, next_xdot_, xddot_);
    }
    return std::max(dry_friction_.violation(next_xdot_.data()),
                    motor_friction_.violation(next_xdot_.data() + num_joints_));
  };
  double high = violation(h);
  if (!(high > 0)) return {};
  const double close_s = 1e-12 * h;
  double low = 0, low_s = 0, high_s = h;
  bool was_beyond = true;
  for (int k = 0; high_s - low_s > close_s; ++k) {
    // Regula falsi, Illinois variant: the value at an end that stays is halved. The point keeps a
    // distance of half of `close_s` from both ends.
    const double share = k % 3 == 0 || !(low < 0) ? 0.5 : low / (low - high);
    const double middle_s =
        std::clamp(low_s + share * (high_s - low_s), low_s + close_s / 2, high_s - close_s / 2);
    try_step(middle_s);
    const double middle = violation(middle_s);
    const bool beyond = middle > 0, same_side = beyond == was_beyond;
    if (beyond) {
      high = middle;
      high_s = middle_s;
      if (same_side) low /= 2;
    } else {
      low = middle;
      low_s = middle_s;
      if (same_side) high /= 2;
    }
    was_beyond = beyond;
  }
  try_step(high_s);
  return high_s;
}

/// Computes the step of length h into next_x_ and next_xdot_.
/// @return the largest relative error as estimated; NaN if one is NaN.
double Arm::try_step(double h) {
  for (std::size_t i = 0; i < num_stages; ++i) {
    double time_s = now_s_;
    next_x_ = x_;
    next_xdot_ = xdot_;
    for (std::size_t j = 0; j < i; ++j) {
      const double weight = h * a[i][j];
      time_s += weight;
      if (weight == 0) continue;
      next_x_ += weight * rate_[j];
      next_xdot_ += weight * acceleration_[j];
    }
    rate_[i] = next_xdot_;
    accelerate(time_s, next_x_, next_xdot_, acceleration_[i]);
  }
  next_x_ = x_;
  next_xdot_ = xdot_;
  error_x_.setZero(x_.size());
  error_xdot_.setZero(x_.size());
  for (std::size_t i = 0; i < num_stages; ++i) {
    next_x_ += (h * b[i]) * rate_[i];
    next_xdot_ += (h * b[i]) * acceleration_[i];
    error_x_ += (h * e[i]) * rate_[i];
    error_xdot_ += (h * e[i]) * acceleration_[i];
  }
  return step_error(error_xdot_, xdot_, step_error(error_x_, x_, 0));
}

void Arm::brake(const Vector& damping) {
  require_size(damping, num_joints_);
  (flexible_ ? motor_damping_ : viscous_friction_) += damping;
  tau_.setZero();
  lag_.setZero();
  torque_offset_.setZero();
}

}  // namespace tachless::plant

#include "lyapunov/one_tick.h"

#include <limits>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include "plant/plant_model.h"
#include "robot/dynamics.h"

namespace tachless::lyapunov {

using Eigen::Index;
using Eigen::VectorXd;

struct OneTick::Arms {
  std::mutex mutex;
  std::vector<plant::Arm> idle;
};

OneTick::OneTick(const scenario::Scenario& scenario, const Vector& q_ref)
    : loop_(scenario),
      reference_(linear::constant_reference(q_ref)),
      model_(linear::plant_of(scenario)),
      settings_(loop_.settings()),
      law_(loop_.stepped(reference_)),
      arms_(std::make_shared<Arms>()) {
  torque_ = robot::gravity_torque(model_, q_ref);
  auto native = std::make_shared<scenario::Scenario>(scenario);
  native->plant.mechanics = plant::Mechanics::native;
  native->plant.initial = {};
  native->plant.initial.position_rad = q_ref;
  native->plant.initial.velocity_rad_per_s = Vector::Zero(q_ref.size());
  // The offset makes the reference an equilibrium for any scale of the torques.
  native->plant.drive.torque_offset_Nm =
      torque_ - native->plant.drive.torque_scale.cwiseProduct(torque_);
  scenario_ = std::move(native);
  const plant::ArmState rest =
      plant::initial_state(scenario_->plant, scenario_->robot.flexible, model_);
  const bool lags = scenario.plant.drive.current_loop_hz.has_value();
  const Vector currents = lags ? torque_ : VectorXd();
  plant_.resize(2 * (rest.q.size() + rest.theta.size()) + currents.size());
  plant_ << rest.q, rest.v, rest.theta, rest.thetadot, currents;
  measured_ = linear::measured_rows(law_.measured, q_ref.size(), plant_.size());
  limit_ = VectorXd::Constant(q_ref.size(), infinity);
  if (const auto& limit = scenario.plant.drive.torque_limit_Nm) limit_ = *limit;
}

Index OneTick::size() const {
  return plant_.size() + law_.memory.size() + settings_.command_delay * torque_.size();
}

VectorXd OneTick::start(const VectorXd& plant) const {
  VectorXd x = VectorXd::Zero(size());
  x.head(plant_.size()) = plant;
  x.segment(plant_.size(), law_.memory.size()) =
      law_.start(measured_ * (plant_ + plant)) - law_.memory;
  return x;
}

VectorXd OneTick::operator()(const VectorXd& x) const {
  const Index n = num_joints(), p = plant_.size(), m = law_.memory.size();
  const VectorXd now = plant_ + x.head(p);
  const auto [memory, command] = law_.step(law_.memory + x.segment(p, m), measured_ * now);
  const VectorXd newest = command.cwiseMin(limit_).cwiseMax(-limit_) - torque_;
  VectorXd next(x.size());
  next.segment(p, m) = memory - law_.memory;
  const Index under_way = settings_.command_delay * n;
  VectorXd queue(under_way + n);  // with the newest
  queue << newest, x.tail(under_way);
  next.tail(under_way) = queue.head(under_way);
  plant::ArmState state{now.head(n), now.segment(n, n), {}, {}};
  if (p >= 4 * n) {
    state.theta = now.segment(2 * n, n);
    state.thetadot = now.segment(3 * n, n);
  }
  if (p % (2 * n) != 0) state.torque = now.tail(n);
  try {
    std::optional<plant::Arm> arm;
    {
      const std::lock_guard lock(arms_->mutex);
      if (!arms_->idle.empty()) {
        arm.emplace(std::move(arms_->idle.back()));
        arms_->idle.pop_back();
      }
    }
    if (!arm)
      arm.emplace(plant::make_arm(scenario_->plant, scenario_->robot.flexible, model_, state));
    arm->set_state(state, 0);
    arm->advance(torque_ + queue.tail(n), settings_.period_s);
    const plant::ArmState after = arm->state();
    next.head(p) << after.q, after.v, after.theta, after.thetadot, after.torque;
    next.head(p) -= plant_;
    const std::lock_guard lock(arms_->mutex);
    arms_->idle.push_back(std::move(*arm));
  } catch (const std::runtime_error&) {
    next.setConstant(std::numeric_limits<double>::quiet_NaN());
  }
  return next;
}

Eigen::MatrixXd OneTick::linear() const {
  const linear::SampledLoop about = loop_.at(reference_);
  return linear::cut(about.plant, about.law(settings_.period_s), settings_.period_s, about.delay)
      .closed();
}

}  // namespace tachless::lyapunov

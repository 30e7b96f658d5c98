#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "base/failure.h"
#include "own_loop/loop_impl.h"
#include "own_loop/own_loop.h"
#include "plant/drive.h"
#include "plant/motion_guard.h"
#include "robot/dynamics.h"

namespace tachless::own_loop {
namespace {

/// Returns the limits of the scenario's drives without their delays.
plant::DriveSpec limits_of(const scenario::Scenario& scenario) {
  plant::DriveSpec drive = scenario.plant.drive;
  drive.command_age_jitter_ticks = 0;
  if (drive.torque_limit_Nm && drive.torque_limit_Nm->allFinite()) return drive;
  throw scenario.complaint("plant.drive.torque_limit_Nm",
                           "no limit; the guards need one for each joint");
}

Vector vector_of(const Numbers& numbers) {
  return Eigen::Map<const Eigen::VectorXd>(numbers.data(),
                                           static_cast<Eigen::Index>(numbers.size()));
}

}  // namespace

struct Guards::Impl {
  explicit Impl(std::shared_ptr<const Loop::Impl> examined)
      : loop(std::move(examined)),
        scenario(loop->scenario),
        period_s(scenario.loop.period_s),
        limits(limits_of(scenario)),
        model(*scenario.model),
        motion(model, scenario.robot.urdf_path,
               scenario.plant.following_error_rad.value_or(
                   plant::default_following_error(scenario.num_joints))),
        meter(scenario.num_joints),
        sent(Vector::Zero(scenario.num_joints)) {}

  /// Returns the first guard that the step breaks, or ok, and its joint.
  [[nodiscard]] std::pair<Status, int> broken_by(const Vector& q, const Vector& q_ref) const {
    for (Eigen::Index i = 0; i < q.size(); ++i) {
      if (motion.is_outside(i, q[i])) return {Status::out_of_range, i};
      if (motion.is_fast(i, q[i], meter.speed()[i])) return {Status::too_fast, i};
    }
    const Eigen::Index late = motion.late_joint(q, q_ref);
    return {late < 0 ? Status::ok : Status::off_reference, late};
  }

  std::shared_ptr<const Loop::Impl> loop;  ///< for the reasons of its steps
  const scenario::Scenario& scenario;
  double period_s;
  plant::DriveSpec limits;
  robot::Model model;
  plant::MotionGuard motion;
  plant::SpeedMeter meter;
  std::optional<plant::Drive> drive;  ///< from the first step of a run on
  Vector sent;                        ///< [N m; N]
  Status broken = Status::ok;
  int broken_joint = -1;
  double broken_value = 0;  ///< position, speed or error of that joint
  double broken_at = 0;     ///< its position [rad; m]
};

Guards::Guards(const Loop& loop) : impl_(std::make_unique<Impl>(loop.impl_)) {}
Guards::Guards(Guards&&) noexcept = default;
Guards& Guards::operator=(Guards&&) noexcept = default;
Guards::~Guards() = default;

Step Guards::check(const Step& step) noexcept {
  Impl& my = *impl_;
  Step result = step;
  result.tau = view(my.sent);
  if (!step.has_torque()) return result;
  const Vector q = vector_of(step.position), q_ref = vector_of(step.desired);
  const double time_s = static_cast<double>(step.tick) * my.period_s;
  my.meter.add(q, time_s, time_s);
  const Vector law_tau = vector_of(step.law_tau);
  if (!my.drive) {  // an arm holds itself until its first command
    my.motion.set_first_error(q, q_ref);
    my.drive.emplace(my.limits, 0, my.period_s, robot::gravity_torque(my.model, q));
  }
  if (my.broken == Status::ok) {
    const auto [broken, joint] = my.broken_by(q, q_ref);
    my.broken = broken;
    my.broken_joint = joint;
    if (joint >= 0) my.broken_at = q[joint];
    if (broken == Status::out_of_range) my.broken_value = q[joint];
    if (broken == Status::too_fast) my.broken_value = my.meter.speed()[joint];
    if (broken == Status::off_reference) my.broken_value = std::abs(q[joint] - q_ref[joint]);
  }
  if (my.broken != Status::ok) {
    result.status = my.broken;
    result.joint = my.broken_joint;
    return result;
  }
  my.drive->set_added(vector_of(step.arm_tau));
  my.drive->accept({law_tau});
  my.sent = my.scenario.robot.joint_signs.cwiseProduct(my.drive->sent());
  const auto& saturated = my.drive->applied().saturated;
  result.saturated = std::find(saturated.begin(), saturated.end(), true) != saturated.end();
  my.drive->end_tick();
  return result;
}

void Guards::reset() noexcept {
  Impl& my = *impl_;
  my.drive.reset();
  my.meter = plant::SpeedMeter(my.sent.size());
  my.broken = Status::ok;
}

std::string Guards::reason(const Step& step) const {
  const Impl& my = *impl_;
  switch (step.status) {
    case Status::out_of_range:
      return my.motion.range_text(step.joint, my.broken_value, step.tick);
    case Status::too_fast:
      return my.motion.speed_text(step.joint, my.broken_at, my.broken_value, step.tick);
    case Status::off_reference:
      return my.motion.following_text(step.joint, my.broken_value, step.tick);
    default:
      return my.loop->reason(step);
  }
}

}  // namespace tachless::own_loop

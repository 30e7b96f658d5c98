#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "controller/registry.h"
#include "messages/measurements.h"
#include "own_loop/loop_scenario.h"
#include "own_loop/own_loop.h"
#include "plant/motion_guard.h"
#include "plant/own_torque.h"
#include "reference/make_trajectory.h"
#include "robot/model.h"

namespace tachless::own_loop {

/// Bounds of the caller's references, one entry per joint.
struct Bounds {
  Vector speed, acceleration, lower, upper;

  /// Gives every joint the entry of a list with one entry. Takes missing positions from the URDF.
  /// @throw base::Failure(bad_usage) for a wrong number of entries, or an entry that is out of
  /// range
  Bounds(const ReferenceBounds& given, const robot::Model& model);

  /// Returns the first joint that is beyond the bounds; -1: none. With `before`, the changes of
  /// position and velocity since `before` are checked too, against speed and acceleration.
  /// @param before the last reference, `passed_s` earlier [s]; null: none
  [[nodiscard]] int beyond(const messages::ReferencePoint& reference,
                           const messages::ReferencePoint* before, double passed_s) const;
};

/// Returns a view of `x`, which outlives the view.
Numbers view(const Vector& x);

struct Loop::Impl {
  explicit Impl(LoopScenario made);

  /// Steps the law with the member `reference`.
  /// @param status, joint result of the check of `reference`, for the returned step
  Step step(std::int64_t tick, Numbers position, Status status, int joint) noexcept;
  /// Copies a reference of the caller into the member `reference`.
  /// @return false if `given` has another number of joints
  bool take(const Reference& given);
  /// Returns a step with this status and with views of the last torques, position and reference.
  [[nodiscard]] Step shown_step(std::int64_t tick, Status status, int joint = -1) const;
  /// Returns why a step of the law is not ok.
  [[nodiscard]] std::string reason(const Step& step) const;
  [[nodiscard]] std::string joint_name(int joint) const;

  scenario::Scenario scenario;
  bool has_reference;
  bool needs_bounds = false;  ///< the loop is certified, and a reference of the caller needs bounds
  bool arm_coordinates;       ///< the arm's coordinates differ from the URDF's
  std::optional<Bounds> bounds;
  controller::ScenarioLaw law;
  reference::Trajectory trajectory;
  std::optional<plant::OwnTorque> own_torque;  ///< torque that the arm adds itself; empty: none
  plant::SpeedMeter meter;

  std::int64_t last_tick = -1;    ///< last tick of this run; -1: none
  std::int64_t first_tick = 0;    ///< tick of the law at which this run began
  bool failed = false;            ///< a step threw; no torque is computed until `reset`
  std::int64_t before_tick = -1;  ///< tick of `before`, the caller's last reference; -1: none
  messages::AnyMeasurement measured{messages::PositionMeasurement{}};
  messages::ReferencePoint reference, before, shown;
  Vector tau, law_tau, added;  ///< torque to send; torque of the law; torque of the arm itself
};

}  // namespace tachless::own_loop

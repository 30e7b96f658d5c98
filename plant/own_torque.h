#pragma once

#include <optional>

#include "base/quantities.h"
#include "robot/dynamics.h"
#include "robot/model.h"
#include "scenario/scenario.h"

namespace tachless::plant {

/// Torque that the arm's own controller adds to the torque that it is sent (robot.compensates).
class OwnTorque {
 public:
  /// Reads robot.compensates.urdf if the scenario gives it.
  /// @throw base::Failure(bad_usage) when that file cannot be read or has other joints
  explicit OwnTorque(const scenario::Scenario& scenario) : adds_(scenario.robot.compensates) {
    if (adds_.adds_torque()) model_ = scenario::own_model(scenario);
  }

  /// Returns true if the arm adds a torque.
  [[nodiscard]] bool any() const { return model_.has_value(); }

  /// Returns the torque that the arm adds at positions q [rad; m] and velocities v [rad/s; m/s]
  /// [N m; N]. Precondition: `any`.
  [[nodiscard]] Vector at(const Vector& q, const Vector& v) const {
    Vector torque = Vector::Zero(q.size());
    if (adds_.gravity) torque += robot::gravity_torque(*model_, q);
    if (adds_.coriolis) torque += robot::coriolis_product(*model_, q, v, v);
    return torque;
  }

 private:
  scenario::CompensationSpec adds_;
  std::optional<robot::Model> model_;
};

}  // namespace tachless::plant

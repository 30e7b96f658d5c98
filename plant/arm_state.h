#pragma once

#include <limits>

#include "base/quantities.h"

namespace tachless::plant {

/// What a robot does at an instant.
struct ArmState {
  Vector q;         ///< link position [rad; m if prismatic]
  Vector v;         ///< link velocity [rad/s; m/s]
  Vector theta;     ///< motor position [rad]; empty on a rigid robot
  Vector thetadot;  ///< motor velocity [rad/s]; empty on a rigid robot
  /// Torque on the links that no drive gives [N m; N]; empty: none. For the log alone.
  Vector disturbance{};
  /// Of the drives' current loops, where they lag [N m; N]; empty: zero.
  Vector torque{};
  /// The robot's own time, from anywhere [s]; NaN: it tells none.
  double time_s = std::numeric_limits<double>::quiet_NaN();
};

}  // namespace tachless::plant

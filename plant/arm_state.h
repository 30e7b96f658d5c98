#pragma once

#include "robot/quantities.h"

namespace tachless::plant {

/// What a robot does at an instant.
struct ArmState {
  robot::Vector q;         ///< link position [rad; m if prismatic]
  robot::Vector v;         ///< link velocity [rad/s; m/s]
  robot::Vector theta;     ///< motor position [rad]; empty on a rigid robot
  robot::Vector thetadot;  ///< motor velocity [rad/s]; empty on a rigid robot
  /// Torque on the links that no drive gives [N m; N]; empty: none. For the log alone.
  robot::Vector disturbance{};
};

}  // namespace tachless::plant

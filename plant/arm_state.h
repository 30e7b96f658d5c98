#pragma once

#include <limits>
#include <optional>
#include <string>

#include "base/quantities.h"

namespace tachless::plant {

/// Contact of a simulated robot: the two geoms with the largest contact force.
struct Contact {
  std::string simulator;  ///< name and version of the simulator
  std::string geoms;      ///< "tip, wall", the robot's first; empty: no contact
  double force = 0;       ///< between the two [N]
};

/// State of a robot at an instant.
struct ArmState {
  Vector q;         ///< link position [rad; m if prismatic]
  Vector v;         ///< link velocity [rad/s; m/s]
  Vector theta;     ///< motor position [rad]; empty on a rigid robot
  Vector thetadot;  ///< motor velocity [rad/s]; empty on a rigid robot
  /// Torque on the links that no drive gives [N m; N]; empty: none. Only the log uses it.
  Vector disturbance{};
  /// Torque of the drives where a current loop lags [N m; N]; empty: zero.
  Vector torque{};
  /// The robot's own time since an arbitrary instant [s]; NaN: the robot reports no time.
  double time_s = std::numeric_limits<double>::quiet_NaN();
  /// True: the robot did not answer in time, and no other member is valid. The tick is a missed
  /// tick.
  bool missing = false;
  /// Contact, of a simulator that knows contacts. Only the log uses it.
  std::optional<Contact> contact{};
  /// Torque that a real arm accepted and that acts, for the log alone [N m; N]; empty: the arm does
  /// not report it. The torque has the driver's signs and is without the torque that the arm adds
  /// itself, as in RobotDriver::hold.
  Vector accepted{};
  /// Torque by the arm's sensors or currents, gravity included, for the log alone [N m; N]; empty:
  /// the arm does not report it. The torque has the driver's signs.
  Vector measured{};
};

}  // namespace tachless::plant

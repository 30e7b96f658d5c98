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
  /// Torques that a real arm reports with its reading, for the log alone [N m; N]; empty: not
  /// reported. The torques have the driver's signs. `accepted` is the torque that the arm accepted
  /// and that acts, without the torque that the arm adds itself, as in RobotDriver::hold.
  /// `measured` comes from sensors or currents, gravity included.
  Vector accepted{}, measured{};
};

}  // namespace tachless::plant

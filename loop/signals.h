#pragma once

#include <array>

#include "robot/quantities.h"

/// The values that travel round the loop, without ticks or times: those belong to the nodes.
/// One type per measurement, no inheritance and no conversion between them, so that a law sees
/// what its type holds and nothing else.
namespace tachless::loop {

/// What an output-feedback law of a rigid robot sees.
struct PositionMeasurement {
  robot::Vector q;  ///< link position [rad; m if prismatic]
};

/// What an output-feedback law of a flexible-joint robot with motor encoders sees.
struct MotorPositionMeasurement {
  robot::Vector theta;  ///< motor position, on the link side of the gear [rad]
};

/// What the flexible-joint law of Loria and Ortega (eq. 9-12) sees: no motor velocity.
struct LinkStateMeasurement {
  robot::Vector q;      ///< link position [rad; m if prismatic]
  robot::Vector v;      ///< link velocity [rad/s]
  robot::Vector theta;  ///< motor position [rad]
};

/// Full state. On a rigid robot `theta` and `thetadot` are empty.
struct StateMeasurement {
  robot::Vector q;         ///< link position [rad; m if prismatic]
  robot::Vector v;         ///< link velocity [rad/s]
  robot::Vector theta;     ///< motor position [rad]
  robot::Vector thetadot;  ///< motor velocity [rad/s]
};

/// A C4 reference at one instant.
struct ReferencePoint {
  robot::Vector q_ref;     ///< [rad; m if prismatic]
  robot::Vector v_ref;     ///< [rad/s]
  robot::Vector a_ref;     ///< [rad/s^2]
  robot::Vector jerk_ref;  ///< [rad/s^3]
  robot::Vector snap_ref;  ///< [rad/s^4]
};

struct TorqueCommand {
  robot::Vector tau;  ///< motor torque [N m; N if prismatic], positive accelerates the joint
};

inline constexpr int max_filters = 2;

/// What a law computed on the way to its command, for the log. Entry i belongs to the law's
/// i-th filter; entries from `num_filters` on are empty.
struct ControllerState {
  int num_filters = 0;
  std::array<robot::Vector, max_filters> error;  ///< measured minus reference [rad]
  std::array<robot::Vector, max_filters> nu;     ///< filter output [rad/s] (the paper's vartheta)
};

}  // namespace tachless::loop

#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

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

/// Name and unit of one signal that a law declares, for the log. The unit is that of a revolute
/// joint, in SI symbols ("rad", "rad/s", "N m"); the name holds neither ':' nor ','.
struct Signal {
  std::string_view name;
  std::string_view unit;
};

/// Most signals that a law may declare.
inline constexpr int max_signals = 8;

/// What a law computed on the way to its command, for the log: entry i belongs to the i-th signal
/// that the law declares and has one value per joint; entries from `num` on are empty. The first
/// signal of every law is the position error whose norm the controller announces.
struct LawSignals {
  int num = 0;
  std::array<robot::Vector, max_signals> value;
};

/// "error:rad,nu:rad/s": how declared signals travel in participant_t and run_info_t.
std::string text_of(std::span<const Signal> signals);

/// The reverse; views into `text`. Nothing when it is not such a text, or declares more than
/// `max_signals`; an empty text declares none.
std::optional<std::vector<Signal>> parse_signals(std::string_view text);

}  // namespace tachless::loop

#pragma once

#include <array>
#include <cstdint>

#include "robot/quantities.h"

namespace tachless::loop::truth {

enum class DriveFault : std::int8_t {
  none = 0,
  command_missed = 1,   ///< the last torque is held
  protective_stop = 2,  ///< drives brake viscously
};

/// The plant's exact state at the start of a tick and what its drives did over that tick. Goes to
/// the logger and nowhere else: no target of controller/ links to this one.
struct PlantTruth {
  robot::Vector q;         ///< link position [rad; m if prismatic]
  robot::Vector v;         ///< link velocity [rad/s]
  robot::Vector theta;     ///< motor position [rad]; empty on a rigid robot
  robot::Vector thetadot;  ///< motor velocity [rad/s]; empty on a rigid robot
  robot::Vector tau;       ///< torque applied over the tick, after the limit [N m]
  std::array<bool, robot::max_joints> saturated{};  ///< the commanded torque exceeded the limit
  DriveFault fault = DriveFault::none;
};

}  // namespace tachless::loop::truth

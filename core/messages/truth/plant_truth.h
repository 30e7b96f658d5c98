#pragma once

#include <array>
#include <cstdint>

#include "base/quantities.h"
#include "messages/field.h"

namespace tachless::messages::truth {

enum class DriveFault : std::int8_t {
  none = 0,
  command_missed = 1,   ///< the last torque is held
  protective_stop = 2,  ///< drives brake viscously
};

/// The plant's exact state at the start of a tick, and the action of its drives over that tick.
/// Only the logger receives this message: no target of controller/ links to its target. On a rigid
/// robot `theta` and `thetadot` are empty.
struct PlantTruth {
  Vector q, v, theta, thetadot;
  Vector tau;
  Vector disturbance;  ///< generalised forces of disturbances or contacts [N m; N]
  std::array<bool, max_joints> saturated{};
  DriveFault fault = DriveFault::none;

  using Value = PlantTruth;
  static constexpr std::string_view type = "tachless_truth.plant_truth_t", suffix = "TRUTH";
  static constexpr std::size_t num_states = 4;  ///< first fields; the others are the drives'
  static constexpr auto fields = std::tuple{
      per_joint("position", "q", "rad", &Value::q, "link position"),
      per_joint("velocity", "v", "rad/s", &Value::v, "link velocity"),
      per_motor("motor_position", "theta", "rad", &Value::theta,
                "motor position on the link side of the gear"),
      per_motor("motor_velocity", "thetadot", "rad/s", &Value::thetadot, "motor velocity"),
      per_joint("torque", "tau_applied", "N m", &Value::tau,
                "torque applied over the tick, after the limit"),
      per_joint("disturbance", "tau_disturbance", "N m", &Value::disturbance,
                "torque of plant.disturbances or of contacts at the start of the tick"),
      Field<Value, std::array<bool, max_joints>>{
          "saturated", "saturated", "", Kind::flag, Count::joints, &Value::saturated,
          "1 when the commanded torque exceeded a limit of the drive"},
      Field<Value, DriveFault>{"fault", "drive_fault", "", Kind::int8, Count::one, &Value::fault,
                               "0 none, 1 command missed (last torque held), 2 protective stop", 0,
                               static_cast<double>(DriveFault::protective_stop)}};
};

}  // namespace tachless::messages::truth

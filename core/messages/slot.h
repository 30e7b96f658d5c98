#pragma once

#include <array>
#include <cstddef>

/// The kinds of message of one tick, by name. core/messages/truth/tick_record.h holds their values.
namespace tachless::messages {

/// Kinds of message in the order of the canonical log. Only a run with plant.mujoco has `contact`.
/// Only a run of a real arm that reports torques has `arm_torque`.
enum class Slot : int {
  tick,
  measurement,
  reference,
  command,
  controller_state,
  truth,
  contact,
  arm_torque
};
inline constexpr int num_slots = 8;
inline constexpr std::array<Slot, num_slots> all_slots = {
    Slot::tick,  Slot::measurement, Slot::reference, Slot::command, Slot::controller_state,
    Slot::truth, Slot::contact,     Slot::arm_torque};

constexpr std::size_t index(Slot slot) { return static_cast<std::size_t>(slot); }

}  // namespace tachless::messages

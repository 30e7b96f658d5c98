#pragma once

#include <array>
#include <cstddef>

/// The six kinds of message that make up one tick. Names only; core/messages/truth/tick_record.h
/// holds what they carry.
namespace tachless::messages {

/// In the order of the canonical log.
enum class Slot : int { tick, measurement, reference, command, controller_state, truth };
inline constexpr int num_slots = 6;
inline constexpr std::array<Slot, num_slots> all_slots = {
    Slot::tick,    Slot::measurement,      Slot::reference,
    Slot::command, Slot::controller_state, Slot::truth};

constexpr std::size_t index(Slot slot) { return static_cast<std::size_t>(slot); }

}  // namespace tachless::messages

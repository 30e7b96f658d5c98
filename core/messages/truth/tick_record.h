#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <tuple>
#include <type_traits>
#include <variant>

#include "messages/measurements.h"
#include "messages/messages.h"
#include "messages/slot.h"
#include "messages/truth/arm_torque.h"
#include "messages/truth/contact.h"
#include "messages/truth/plant_truth.h"

/// All messages of one tick, for logs and offline use. Controllers may not include it, because it
/// holds the truth.
namespace tachless::messages {

/// Messages of one tick; nothing: the message is missing.
struct TickRecord {
  std::int64_t tick = 0;
  std::optional<Tick> clock;
  std::optional<AnyMeasurement> measurement;
  std::optional<ReferencePoint> reference;
  std::optional<TorqueCommand> command;
  std::optional<LawSignals> controller_state;
  std::optional<truth::PlantTruth> truth;
  std::optional<truth::Contact> contact;       ///< only with plant.mujoco
  std::optional<truth::ArmTorque> arm_torque;  ///< only of a real arm that reports torques
};

/// Types of the messages in a TickRecord besides the measurement.
using TickMessages = TypeList<Tick, ReferencePoint, TorqueCommand, LawSignals, truth::PlantTruth,
                              truth::Contact, truth::ArmTorque>;

template <class... Value>
TypeList<Value..., truth::PlantTruth, truth::Contact, truth::ArmTorque> with_truth(
    TypeList<Value...>);
/// Every type of message.
using AllMessages = decltype(with_truth(Messages()));

/// True for message types with a slot: every tick of a run has at most one such message.
template <class Value>
constexpr bool once_per_tick =
    !std::is_same_v<Value, Participant> && !std::is_same_v<Value, RunInfo> &&
    !std::is_same_v<Value, LogAck> && !std::is_same_v<Value, GainChange> &&
    !std::is_same_v<Value, GainAck>;

/// Returns the slot of a message type.
template <class Value>
constexpr Slot slot_of() {
  if constexpr (is_measurement<Value>) return Slot::measurement;
  if constexpr (std::is_same_v<Value, Tick>) return Slot::tick;
  if constexpr (std::is_same_v<Value, ReferencePoint>) return Slot::reference;
  if constexpr (std::is_same_v<Value, TorqueCommand>) return Slot::command;
  if constexpr (std::is_same_v<Value, LawSignals>) return Slot::controller_state;
  if constexpr (std::is_same_v<Value, truth::PlantTruth>) return Slot::truth;
  if constexpr (std::is_same_v<Value, truth::Contact>) return Slot::contact;
  if constexpr (std::is_same_v<Value, truth::ArmTorque>) return Slot::arm_torque;
}

/// Returns the record's messages in the order of Slot; `Record` is TickRecord, const or not.
template <class Record>
auto by_slot(Record& record) {
  return std::tie(record.clock, record.measurement, record.reference, record.command,
                  record.controller_state, record.truth, record.contact, record.arm_torque);
}

/// Type of a message's member in the record.
template <class Value>
using Held = std::optional<std::conditional_t<is_measurement<Value>, AnyMeasurement, Value>>;

template <class Value>
void put(TickRecord& record, const Value& value) {
  std::get<Held<Value>&>(by_slot(record)) = value;
}

/// Returns the record's message of that type. Precondition: the record has one.
template <class Value>
const Value& get(const TickRecord& record) {
  const auto& held = *std::get<const Held<Value>&>(by_slot(record));
  if constexpr (is_measurement<Value>) {
    return std::get<Value>(held);
  } else {
    return held;
  }
}

/// Returns whether the record has a message in that slot.
inline bool has(const TickRecord& record, Slot slot) {
  return std::apply(
      [&](const auto&... held) { return std::array{held.has_value()...}[index(slot)]; },
      by_slot(record));
}

}  // namespace tachless::messages

#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <tuple>
#include <type_traits>
#include <variant>

#include "loop/measurements.h"
#include "loop/messages.h"
#include "loop/slot.h"
#include "loop/truth/plant_truth.h"

/// All messages of one tick, for logs and offline use. Not for controllers: it holds the truth.
namespace tachless::loop {

struct TickRecord {
  std::int64_t tick = 0;
  std::optional<Tick> clock;
  OptionalMeasurement measurement;
  std::optional<ReferencePoint> reference;
  std::optional<TorqueCommand> command;
  std::optional<LawSignals> controller_state;
  std::optional<truth::PlantTruth> truth;
};

/// Types of the messages in a TickRecord besides the measurement.
using TickMessages = TypeList<Tick, ReferencePoint, TorqueCommand, LawSignals, truth::PlantTruth>;

template <class... Value>
TypeList<Value..., truth::PlantTruth> with_truth(TypeList<Value...>);
/// Every type of message.
using AllMessages = decltype(with_truth(Messages()));

/// Whether messages of the type are sent for every tick of a run, and have a slot.
template <class Value>
constexpr bool once_per_tick = !std::is_same_v<Value, Participant> &&
                               !std::is_same_v<Value, RunInfo> && !std::is_same_v<Value, LogAck>;

/// The slot of a message type.
template <class Value>
constexpr Slot slot_of() {
  if constexpr (is_measurement<Value>) return Slot::measurement;
  if constexpr (std::is_same_v<Value, Tick>) return Slot::tick;
  if constexpr (std::is_same_v<Value, ReferencePoint>) return Slot::reference;
  if constexpr (std::is_same_v<Value, TorqueCommand>) return Slot::command;
  if constexpr (std::is_same_v<Value, LawSignals>) return Slot::controller_state;
  if constexpr (std::is_same_v<Value, truth::PlantTruth>) return Slot::truth;
}

/// The record's messages besides the measurement; `Record` is TickRecord, const or not.
template <class Record>
auto others(Record& record) {
  return std::tie(record.clock, record.reference, record.command, record.controller_state,
                  record.truth);
}

template <class Value>
void put(TickRecord& record, const Value& value) {
  if constexpr (is_measurement<Value>) {
    record.measurement = value;
  } else {
    std::get<std::optional<Value>&>(others(record)) = value;
  }
}

/// The record's message of that type, which it has.
template <class Value>
const Value& get(const TickRecord& record) {
  if constexpr (is_measurement<Value>) {
    return std::get<Value>(record.measurement);
  } else {
    return *std::get<const std::optional<Value>&>(others(record));
  }
}

/// Whether the record has a message in that slot.
inline bool has(const TickRecord& record, Slot slot) {
  const std::array<bool, num_slots> present = {
      record.clock.has_value(),   record.measurement.index() != 0,     record.reference.has_value(),
      record.command.has_value(), record.controller_state.has_value(), record.truth.has_value()};
  return present[index(slot)];
}

}  // namespace tachless::loop

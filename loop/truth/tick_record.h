#pragma once

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

/// The record's member for messages of the type; `Record` is TickRecord, const or not.
template <class Value, class Record>
auto& entry_of(Record& record) {
  if constexpr (is_measurement<Value>) {
    return record.measurement;
  } else {
    auto others = std::tie(record.clock, record.reference, record.command, record.controller_state,
                           record.truth);
    using Entry = std::conditional_t<std::is_const_v<Record>, const std::optional<Value>,
                                     std::optional<Value>>;
    return std::get<Entry&>(others);
  }
}

/// The record's message of that type, or null.
template <class Value>
const Value* find(const TickRecord& record) {
  const auto& entry = entry_of<Value>(record);
  if constexpr (is_measurement<Value>) {
    return std::get_if<Value>(&entry);
  } else {
    return entry ? &*entry : nullptr;
  }
}

/// Whether the record has a message in that slot.
inline bool has(const TickRecord& record, Slot slot) {
  if (slot == Slot::measurement) return record.measurement.index() != 0;
  bool found = false;
  for_each_type(TickMessages(), [&]<class Value>(std::type_identity<Value>) {
    if (slot_of<Value>() == slot) found = find<Value>(record) != nullptr;
  });
  return found;
}

}  // namespace tachless::loop

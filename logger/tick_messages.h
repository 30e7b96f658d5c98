#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <type_traits>

#include "logger/tick_ranges.h"
#include "messages/measurements.h"
#include "messages/slot.h"
#include "messages/truth/tick_record.h"
#include "messages/truth/truth_wire.h"
#include "messages/wire.h"
#include "scenario/scenario.h"

namespace tachless::logger {

/// Returns whether a run of the scenario has that message in each tick, or may have it.
inline bool has_slot(const scenario::Scenario& scenario, messages::Slot slot) {
  if (may_be_absent(slot)) return scenario.loop.mode == scenario::Mode::realtime;
  return slot != messages::Slot::contact || !scenario.plant.mujoco.model.empty();
}

/// Returns whether a robot of the scenario may have torques that no drive gives.
inline bool has_disturbance(const scenario::Scenario& scenario) {
  return !scenario.plant.disturbances.empty() || has_slot(scenario, messages::Slot::contact);
}

/// The channels of a run's messages of a tick, by slot, and the check of a message. The class keeps
/// no message.
class TickChannels {
 public:
  using Slot = messages::Slot;

  /// @param law as the controller announces it; a law without a known measurement has no channel
  TickChannels(const scenario::Scenario& scenario, const messages::LawInfo& law)
      : robot_(scenario.robot.channel_prefix),
        layout_(messages::layout(scenario.num_joints, scenario.robot.flexible.has_value(),
                                 static_cast<int>(messages::parse_signals(law.signals)->size()))) {
    for_each_type(messages::TickMessages(), [&]<class Value>(std::type_identity<Value>) {
      if (has_slot(scenario, messages::slot_of<Value>())) use<Value>();
    });
    messages::with_measurement(law.measurement, [&]<class M>(std::type_identity<M>) { use<M>(); });
  }

  [[nodiscard]] const std::string& channel(Slot slot) const { return channels_[index(slot)]; }

  /// Returns the lengths of the longest messages, by slot [bytes]; 0 without a channel.
  [[nodiscard]] const std::array<std::size_t, messages::num_slots>& longest() const {
    return longest_;
  }

  /// Returns true if the TRUTH that was checked last belongs to a protective stop.
  [[nodiscard]] bool is_stopped() const {
    return truth_->fault == messages::truth::DriveFault::protective_stop;
  }

  /// Checks a message. Precondition: `channel(slot)` is not empty.
  messages::Rejection check(Slot slot, std::span<const std::byte> payload,
                            messages::Stamp& stamp) const {
    return check_[index(slot)](payload, stamp);
  }

 private:
  template <class Value>
  void use() {
    struct Checker {
      messages::Codec<Value> codec;
      Value value;
    };
    constexpr std::size_t at = index(messages::slot_of<Value>());
    const auto checker = std::make_shared<Checker>(Checker{messages::Codec<Value>(layout_), {}});
    channels_[at] = messages::channel<Value>(robot_);
    longest_[at] = checker->codec.longest();
    if constexpr (std::is_same_v<Value, messages::truth::PlantTruth>) {
      truth_ = {checker, &checker->value};
    }
    check_[at] = [checker](std::span<const std::byte> payload, messages::Stamp& stamp) {
      return checker->codec.decode(payload, stamp, checker->value);
    };
  }

  std::string robot_;
  messages::Layout layout_;
  std::shared_ptr<const messages::truth::PlantTruth> truth_;  ///< checked last
  std::array<std::string, messages::num_slots> channels_;
  std::array<std::size_t, messages::num_slots> longest_{};
  std::array<std::function<messages::Rejection(std::span<const std::byte>, messages::Stamp&)>,
             messages::num_slots>
      check_;
};

}  // namespace tachless::logger

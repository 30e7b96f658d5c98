#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <type_traits>

#include "bus/truth/truth_wire.h"
#include "bus/wire.h"
#include "experiment/scenario.h"
#include "loop/measurements.h"
#include "loop/slot.h"
#include "loop/truth/tick_record.h"

namespace tachless::logger {

/// The six messages of a tick of a run, by slot: their channels, and whether one is sound. Keeps
/// none.
class RunMessages {
 public:
  using Slot = loop::Slot;

  /// @param law as the controller announces it; without a known measurement that has no channel
  RunMessages(const experiment::Scenario& scenario, const loop::LawInfo& law)
      : robot_(scenario.robot.channel_prefix),
        layout_(loop::layout(scenario.num_joints, scenario.robot.flexible.has_value(),
                             static_cast<int>(loop::parse_signals(law.signals)->size()))) {
    for_each_type(loop::TickMessages(),
                  [&]<class Value>(std::type_identity<Value>) { use<Value>(); });
    loop::with_measurement(law.measurement, [&]<class M>(std::type_identity<M>) { use<M>(); });
  }

  [[nodiscard]] const std::string& channel(Slot slot) const { return channels_[index(slot)]; }

  /// Longest messages, by slot [bytes].
  [[nodiscard]] const std::array<std::size_t, loop::num_slots>& longest() const { return longest_; }

  /// Precondition: `channel(slot)` is not empty.
  bus::Rejection check(Slot slot, std::span<const std::byte> payload, loop::Stamp& stamp) const {
    return check_[index(slot)](payload, stamp);
  }

 private:
  template <class Value>
  void use() {
    struct Checker {
      bus::Codec<Value> codec;
      Value value;  ///< what messages say is of no interest here
    };
    constexpr std::size_t at = index(loop::slot_of<Value>());
    const auto checker = std::make_shared<Checker>(Checker{bus::Codec<Value>(layout_), {}});
    channels_[at] = loop::channel<Value>(robot_);
    longest_[at] = checker->codec.longest();
    check_[at] = [checker](std::span<const std::byte> payload, loop::Stamp& stamp) {
      return checker->codec.decode(payload, stamp, checker->value);
    };
  }

  std::string robot_;
  loop::Layout layout_;
  std::array<std::string, loop::num_slots> channels_;
  std::array<std::size_t, loop::num_slots> longest_{};
  std::array<std::function<bus::Rejection(std::span<const std::byte>, loop::Stamp&)>,
             loop::num_slots>
      check_;
};

}  // namespace tachless::logger

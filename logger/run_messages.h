#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "bus/truth/truth_wire.h"
#include "bus/wire.h"
#include "experiment/scenario.h"
#include "loop/measurements.h"
#include "loop/slot.h"
#include "loop/truth/tick_record.h"

namespace tachless::logger {

/// The six messages of a tick, by slot: their channels, and whether one is sound. Keeps none.
class RunMessages {
 public:
  using Slot = loop::Slot;

  explicit RunMessages(const experiment::Scenario& scenario)
      : robot_(scenario.robot.channel_prefix),
        layout_(loop::layout(scenario.num_joints, scenario.robot.flexible.has_value())) {
    for_each_type(loop::TickMessages(),
                  [&]<class Value>(std::type_identity<Value>) { use<Value>(); });
    for_each_type(loop::Measurements(), [&]<class M>(std::type_identity<M>) {
      std::size_t& measurement = longest_[index(Slot::measurement)];
      measurement = std::max(measurement, bus::Codec<M>(layout_).longest());
    });
  }

  /// Chooses the measurement of this run. @return whether there is such a one.
  bool select_measurement(std::string_view suffix) {
    return loop::with_measurement(suffix, [&]<class M>(std::type_identity<M>) { use<M>(); });
  }

  /// Empty for the measurement that is not chosen yet.
  [[nodiscard]] const std::string& channel(Slot slot) const { return channels_[index(slot)]; }

  /// Longest messages, by slot [bytes]; of all measurements.
  [[nodiscard]] const std::array<std::size_t, loop::num_slots>& longest() const { return longest_; }

  /// Precondition: `channel(slot)` is not empty.
  bus::Rejection check(Slot slot, std::span<const std::byte> payload, loop::Stamp& stamp) const {
    return check_[index(slot)](payload, stamp);
  }

 private:
  template <class Value>
  void use() {
    // The logger does not know laws: one may declare any number of signals.
    constexpr bool has_signals = loop::has_count<Value>(loop::Count::signals);
    struct Checker {
      std::vector<bus::Codec<Value>> codecs;  ///< by number of signals
      Value value;                            ///< what messages say is of no interest here
    };
    const auto checker = std::make_shared<Checker>();
    for (loop::Layout layout = layout_; layout.num_signals <= (has_signals ? loop::max_signals : 0);
         ++layout.num_signals) {
      checker->codecs.emplace_back(layout);
    }
    constexpr std::size_t at = index(loop::slot_of<Value>());
    channels_[at] = loop::channel<Value>(robot_);
    longest_[at] = std::max(longest_[at], checker->codecs.back().longest());
    check_[at] = [checker](std::span<const std::byte> payload, loop::Stamp& stamp) {
      const std::optional<loop::Layout> announced =
          has_signals ? bus::announced_layout<Value>(payload) : loop::Layout{};
      if (!announced) return bus::Rejection::wrong_size;
      const auto num_signals = static_cast<std::size_t>(announced->num_signals);
      return checker->codecs[num_signals].decode(payload, stamp, checker->value);
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

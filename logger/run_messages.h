#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <memory>
#include <span>
#include <stdexcept>
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

/// The six messages of a tick, by slot: their channels, and whether one is sound. Keeps none.
namespace tachless::logger {

/// Checks messages of one slot; what they say is of no interest here.
class Checker {
 public:
  virtual ~Checker() = default;
  virtual bus::Rejection check(std::span<const std::byte> payload, loop::Stamp& stamp) = 0;
  [[nodiscard]] virtual std::size_t longest() const = 0;
};

template <class Value>
class CheckerOf final : public Checker {
 public:
  explicit CheckerOf(const loop::Layout& layout) : codec_(layout) {}
  bus::Rejection check(std::span<const std::byte> payload, loop::Stamp& stamp) override {
    return codec_.decode(payload, stamp, value_);
  }
  [[nodiscard]] std::size_t longest() const override { return codec_.longest(); }

 private:
  bus::Codec<Value> codec_;
  Value value_;
};

/// The logger does not know laws: one may declare any number of signals.
class SignalsChecker final : public Checker {
 public:
  explicit SignalsChecker(loop::Layout layout) {
    for (layout.num_signals = 0; layout.num_signals <= loop::max_signals; ++layout.num_signals) {
      checkers_.emplace_back(layout);
    }
  }
  bus::Rejection check(std::span<const std::byte> payload, loop::Stamp& stamp) override {
    const auto announced = bus::announced_layout<loop::LawSignals>(payload);
    if (!announced) return bus::Rejection::wrong_size;
    return checkers_[static_cast<std::size_t>(announced->num_signals)].check(payload, stamp);
  }
  [[nodiscard]] std::size_t longest() const override { return checkers_.back().longest(); }

 private:
  std::vector<CheckerOf<loop::LawSignals>> checkers_;
};

class RunMessages {
 public:
  using Slot = loop::Slot;

  explicit RunMessages(const experiment::Scenario& scenario)
      : robot_(scenario.robot.channel_prefix),
        layout_(loop::layout(scenario.num_joints, scenario.robot.flexible.has_value())) {
    for_each_type(loop::TickMessages(), [&]<class Value>(std::type_identity<Value>) {
      if constexpr (std::is_same_v<Value, loop::LawSignals>) {
        use<Value>(std::make_unique<SignalsChecker>(layout_));
      } else {
        use<Value>(std::make_unique<CheckerOf<Value>>(layout_));
      }
    });
  }

  /// Chooses the measurement of this run. @return whether there is such a one.
  bool select_measurement(std::string_view suffix) {
    return loop::with_measurement(suffix, [&]<class M>(std::type_identity<M>) {
      use<M>(std::make_unique<CheckerOf<M>>(layout_));
    });
  }

  /// Empty for the measurement that is not chosen yet.
  [[nodiscard]] const std::string& channel(Slot slot) const { return channels_[index(slot)]; }
  [[nodiscard]] const std::array<std::string, loop::num_slots>& channels() const {
    return channels_;
  }

  /// Longest messages, by slot [bytes]; of all measurements.
  [[nodiscard]] std::array<std::size_t, loop::num_slots> longest() const {
    std::array<std::size_t, loop::num_slots> result{};
    for (const Slot slot : loop::all_slots) {
      if (checkers_[index(slot)]) result[index(slot)] = checkers_[index(slot)]->longest();
    }
    for_each_type(loop::Measurements(), [&]<class M>(std::type_identity<M>) {
      std::size_t& measurement = result[index(Slot::measurement)];
      measurement = std::max(measurement, bus::Codec<M>(layout_).longest());
    });
    return result;
  }

  bus::Rejection check(Slot slot, std::span<const std::byte> payload, loop::Stamp& stamp) {
    if (!checkers_[index(slot)]) {
      throw std::logic_error("a measurement came before it was selected");
    }
    return checkers_[index(slot)]->check(payload, stamp);
  }

 private:
  static constexpr std::size_t index(Slot slot) { return static_cast<std::size_t>(slot); }

  template <class Value>
  void use(std::unique_ptr<Checker> checker) {
    constexpr std::size_t at = index(loop::slot_of<Value>());
    channels_[at] = loop::channel<Value>(robot_);
    checkers_[at] = std::move(checker);
  }

  std::string robot_;
  loop::Layout layout_;
  std::array<std::string, loop::num_slots> channels_;
  std::array<std::unique_ptr<Checker>, loop::num_slots> checkers_;
};

}  // namespace tachless::logger

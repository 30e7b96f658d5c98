#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

#include "bus/truth/truth_wire.h"
#include "bus/wire.h"
#include "experiment/scenario.h"
#include "protocol/lockstep/log_window.h"

namespace tachless::logger {

/// Checks messages of one type; what they say is of no interest here.
template <class Value>
class Checker {
 public:
  explicit Checker(const loop::Layout& layout) : codec_(layout) {}
  bus::Rejection check(std::span<const std::byte> payload, loop::Stamp& stamp) {
    return codec_.decode(payload, stamp, value_);
  }
  [[nodiscard]] std::size_t longest() const { return codec_.longest(); }

 private:
  bus::Codec<Value> codec_;
  Value value_;
};

inline loop::Layout layout(const experiment::Scenario& scenario, int num_signals) {
  return loop::layout(scenario.num_joints, scenario.robot.flexible.has_value(), num_signals);
}

/// Whichever measurement the controller is fed with.
class MeasurementChecker {
 public:
  explicit MeasurementChecker(const loop::Layout& layout)
      : checkers_(Checker<loop::PositionMeasurement>(layout),
                  Checker<loop::MotorPositionMeasurement>(layout),
                  Checker<loop::LinkStateMeasurement>(layout),
                  Checker<loop::StateMeasurement>(layout)) {}

  /// @return whether there is such a measurement
  bool select(std::string_view suffix) {
    const std::array suffixes = {loop::ChannelOf<loop::PositionMeasurement>::suffix,
                                 loop::ChannelOf<loop::MotorPositionMeasurement>::suffix,
                                 loop::ChannelOf<loop::LinkStateMeasurement>::suffix,
                                 loop::ChannelOf<loop::StateMeasurement>::suffix};
    const auto found = std::ranges::find(suffixes, suffix);
    if (found == suffixes.end()) return false;
    selected_ = found - suffixes.begin();
    return true;
  }

  bus::Rejection check(std::span<const std::byte> payload, loop::Stamp& stamp) {
    switch (selected_) {
      case 0:
        return std::get<0>(checkers_).check(payload, stamp);
      case 1:
        return std::get<1>(checkers_).check(payload, stamp);
      case 2:
        return std::get<2>(checkers_).check(payload, stamp);
      case 3:
        return std::get<3>(checkers_).check(payload, stamp);
      default:
        throw std::logic_error("a measurement came before it was selected");
    }
  }

  [[nodiscard]] std::size_t longest() const {
    return std::apply([](const auto&... each) { return std::max({each.longest()...}); }, checkers_);
  }

 private:
  std::tuple<Checker<loop::PositionMeasurement>, Checker<loop::MotorPositionMeasurement>,
             Checker<loop::LinkStateMeasurement>, Checker<loop::StateMeasurement>>
      checkers_;
  std::ptrdiff_t selected_ = -1;
};

/// The logger does not know laws: a controller's state may have any number of signals.
class StateChecker {
 public:
  explicit StateChecker(const experiment::Scenario& scenario) {
    for (int signals = 0; signals <= loop::max_signals; ++signals) {
      checkers_.emplace_back(layout(scenario, signals));
    }
  }
  bus::Rejection check(std::span<const std::byte> payload, loop::Stamp& stamp) {
    for (auto& checker : checkers_) {
      const bus::Rejection rejection = checker.check(payload, stamp);
      if (rejection != bus::Rejection::wrong_size) return rejection;
    }
    return bus::Rejection::wrong_size;
  }
  [[nodiscard]] std::size_t longest() const { return checkers_.back().longest(); }

 private:
  std::vector<Checker<loop::LawSignals>> checkers_;
};

/// The six messages of a tick, by slot: their channels, and whether one is sound.
class RunMessages {
 public:
  using Slot = protocol::lockstep::Slot;

  explicit RunMessages(const experiment::Scenario& scenario)
      : robot_(scenario.robot.channel_prefix),
        tick_(layout(scenario, 0)),
        measurement_(layout(scenario, 0)),
        reference_(layout(scenario, 0)),
        command_(layout(scenario, 0)),
        state_(scenario),
        truth_(layout(scenario, 0)) {
    name(Slot::tick) = loop::channel<loop::Tick>(robot_);
    name(Slot::reference) = loop::channel<loop::ReferencePoint>(robot_);
    name(Slot::command) = loop::channel<loop::TorqueCommand>(robot_);
    name(Slot::controller_state) = loop::channel<loop::LawSignals>(robot_);
    name(Slot::truth) = loop::channel<loop::truth::PlantTruth>(robot_);
  }

  /// Chooses the measurement of this run. @return whether there is such a one.
  bool select_measurement(std::string_view suffix) {
    if (!measurement_.select(suffix)) return false;
    name(Slot::measurement) = robot_ + "_" + std::string(suffix);
    return true;
  }

  /// Empty for the measurement that is not chosen yet.
  [[nodiscard]] const std::string& channel(Slot slot) const {
    return channels_[static_cast<std::size_t>(slot)];
  }
  [[nodiscard]] const std::array<std::string, protocol::lockstep::num_slots>& channels() const {
    return channels_;
  }

  /// Longest messages, by slot [bytes].
  [[nodiscard]] std::array<std::size_t, protocol::lockstep::num_slots> longest() const {
    return {tick_.longest(),    measurement_.longest(), reference_.longest(),
            command_.longest(), state_.longest(),       truth_.longest()};
  }

  bus::Rejection check(Slot slot, std::span<const std::byte> payload, loop::Stamp& stamp) {
    switch (slot) {
      case Slot::tick:
        return tick_.check(payload, stamp);
      case Slot::measurement:
        return measurement_.check(payload, stamp);
      case Slot::reference:
        return reference_.check(payload, stamp);
      case Slot::command:
        return command_.check(payload, stamp);
      case Slot::controller_state:
        return state_.check(payload, stamp);
      case Slot::truth:
        return truth_.check(payload, stamp);
    }
    throw std::logic_error("no such slot");
  }

 private:
  std::string& name(Slot slot) { return channels_[static_cast<std::size_t>(slot)]; }

  std::string robot_;
  std::array<std::string, protocol::lockstep::num_slots> channels_;
  Checker<loop::Tick> tick_;
  MeasurementChecker measurement_;
  Checker<loop::ReferencePoint> reference_;
  Checker<loop::TorqueCommand> command_;
  StateChecker state_;
  Checker<loop::truth::PlantTruth> truth_;
};

}  // namespace tachless::logger

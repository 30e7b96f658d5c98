#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <optional>

#include "loop/clock.h"

/// The tick protocol of the realtime mode as pure state machines, beside that of lockstep: events
/// in, verdicts out, time passed in as a value. Nothing is repeated; what comes too late is late.
namespace tachless::protocol::realtime {

/// Which ticks can have begun, seen from a process that is not the clock: ticks come one a period,
/// so a stranger's message from the far future is none of this run's. Holds on to the first tick
/// it is shown; that one may have been late by more than `slack`, so ask only about strangers.
class Pace {
 public:
  /// How much later than all others the first message may have been.
  static constexpr std::chrono::milliseconds slack{200};

  explicit Pace(double period_s) : period_s_(period_s) {}

  /// Whether `tick` can have begun by `now`.
  bool possible(std::int64_t tick, loop::Clock::time_point now) {
    if (tick < 0) return false;
    if (!first_) first_ = First{tick, now};
    const double passed_s = std::chrono::duration<double>(now - first_->at + slack).count();
    return static_cast<double>(tick - first_->tick) <= passed_s / period_s_ + 2;
  }

 private:
  struct First {
    std::int64_t tick = 0;
    loop::Clock::time_point at;
  };

  double period_s_;
  std::optional<First> first_;
};

}  // namespace tachless::protocol::realtime

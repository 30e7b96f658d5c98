#pragma once

#include <chrono>
#include <cstdint>
#include <optional>

#include "loop/clock.h"

/// The tick protocol of the realtime mode as pure state machines, beside that of lockstep: events
/// in, verdicts out, time passed in as a value. No message is repeated or waited for.
namespace tachless::protocol::realtime {

/// Which ticks can have begun, as a process other than the plant can tell: one begins each period,
/// so a message of a tick far ahead is not of this run. Counts from the first tick that it is
/// given, whose message may have been late by more than `slack`: so a refusal is certain only for
/// senders that are not members.
class Pace {
 public:
  /// By how much more than the others the first message may have been delayed.
  static constexpr std::chrono::milliseconds slack{200};

  explicit Pace(double period_s) : period_s_(period_s) {}

  /// Whether `tick` can have begun by `now`.
  bool possible(std::int64_t tick, loop::Clock::time_point now) {
    if (tick < 0) return false;
    if (!first_) first_ = First{tick, now};
    return static_cast<double>(tick - first_->tick) <= periods_until(now + slack) + 2;
  }

  /// Whether no tick is to come: the last of the run is the `newest` received or, for its message
  /// may be lost, it is time for it to have begun.
  [[nodiscard]] bool over(std::int64_t newest, std::int64_t last,
                          loop::Clock::time_point now) const {
    return newest == last ||
           (first_ && static_cast<double>(last - first_->tick) <= periods_until(now));
  }

 private:
  /// Since the first tick shown.
  [[nodiscard]] double periods_until(loop::Clock::time_point now) const {
    return std::chrono::duration<double>(now - first_->at).count() / period_s_;
  }

  struct First {
    std::int64_t tick = 0;
    loop::Clock::time_point at;
  };

  double period_s_;
  std::optional<First> first_;
};

}  // namespace tachless::protocol::realtime

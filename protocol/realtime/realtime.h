#pragma once

#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <stdexcept>

#include "loop/clock.h"
#include "protocol/lockstep/responders.h"

/// The tick protocol of the realtime mode as pure state machines, beside that of lockstep: events
/// in, verdicts out, time passed in as a value. No message is repeated or waited for. The
/// reference's side is that of lockstep (protocol/lockstep/responders.h).
namespace tachless::protocol::realtime {

using lockstep::LawInput;
using lockstep::MessageRing;
using lockstep::Verdict;

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

/// The controller's side: chooses the newest tick whose measurement and reference are both there,
/// once. Ticks may be skipped, and a skipped one is not computed later.
class CommandPicker {
 public:
  explicit CommandPicker(std::int64_t num_ticks)
      : num_ticks_(num_ticks),
        ring_(std::array{MessageRing::digest_only, MessageRing::digest_only}) {}

  Verdict on_input(LawInput input, std::int64_t tick, std::span<const std::byte> bytes) {
    if (tick < 0 || tick >= num_ticks_) return Verdict::not_asked;
    const Verdict verdict = ring_.put(tick, input, bytes);
    if (verdict != Verdict::fresh || input != lockstep::measurement_input) return verdict;
    newest_ = std::max(newest_, tick);
    return tick > last_ ? Verdict::fresh : Verdict::too_old;
  }

  /// The tick to compute now; nothing when there is none newer than the last one.
  [[nodiscard]] std::optional<std::int64_t> due() const {
    // A reference that is one tick ahead may have taken the place of a tick `depth` before it.
    const std::int64_t oldest = std::max(last_ + 1, newest_ - MessageRing::depth + 2);
    for (std::int64_t tick = newest_; tick >= oldest; --tick) {
      if (ring_.has(tick, lockstep::measurement_input) &&
          ring_.has(tick, lockstep::reference_input)) {
        return tick;
      }
    }
    return std::nullopt;
  }
  /// The command of `tick`, which was due, is computed.
  void acted(std::int64_t tick) {
    if (tick <= last_) throw std::logic_error("a tick was acted on out of turn");
    last_ = tick;
  }

 private:
  std::int64_t num_ticks_;
  std::int64_t last_ = -1;    ///< newest tick computed
  std::int64_t newest_ = -1;  ///< newest measurement
  MessageRing ring_;
};

/// The plant's side: accepts a command only within its tick, counts the ticks without a command and
/// reports when too many in a row had none. Does not hold the torque or stop the robot: the plant
/// does.
class MissedCommandMonitor {
 public:
  /// @param max_missed commands that may be missed in a row
  explicit MissedCommandMonitor(int max_missed)
      : max_missed_(max_missed), commands_(std::array{MessageRing::digest_only}) {}

  void begin(std::int64_t tick) {
    tick_ = tick;
    commanded_ = false;
  }

  /// A command of this run. `fresh`: the first of the present tick; `too_old`: of a tick that is
  /// over; `not_asked`: of a tick that has not begun.
  Verdict on_command(std::int64_t tick, std::span<const std::byte> bytes) {
    if (tick < 0 || tick > tick_) return Verdict::not_asked;
    const Verdict verdict = commands_.put(tick, 0, bytes);
    if (verdict != Verdict::fresh) return verdict;
    if (tick < tick_) return Verdict::too_old;
    commanded_ = true;
    return Verdict::fresh;
  }
  /// Whether this tick's command was received.
  [[nodiscard]] bool commanded() const { return commanded_; }

  /// The tick is over.
  void end() {
    in_a_row_ = commanded_ ? 0 : in_a_row_ + 1;
    missed_ += commanded_ ? 0 : 1;
    longest_ = std::max(longest_, in_a_row_);
  }

  [[nodiscard]] std::int64_t missed() const { return missed_; }  ///< ticks without a command
  [[nodiscard]] std::int64_t missed_in_a_row() const { return in_a_row_; }  ///< at present
  [[nodiscard]] std::int64_t longest_miss() const { return longest_; }      ///< most in a row
  /// More than `max_missed` in a row: the protective stop is due.
  [[nodiscard]] bool too_many() const { return in_a_row_ > max_missed_; }

 private:
  int max_missed_;
  MessageRing commands_;
  std::int64_t tick_ = -1;
  bool commanded_ = false;
  std::int64_t missed_ = 0;
  std::int64_t in_a_row_ = 0;
  std::int64_t longest_ = 0;
};

}  // namespace tachless::protocol::realtime

#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "base/clock.h"
#include "session/message_ring.h"

/// The processes' sides of the tick protocol: the reference in both modes, the controller and the
/// plant in each. In lockstep every request is answered once, in order. The reply is kept for a
/// request that comes again (the plant's side: tick_master.h). In realtime no process repeats a
/// message or waits for one.
namespace tachless::session {

/// The reference's side: TICK(k) requests every reference up to k + 1 that is not yet published, so
/// that no process waits for the reference, and TICK(k + 1) makes up for a lost TICK(k). The reply
/// to a repeated TICK is the same bytes again. In realtime what has gone by is left out: references
/// before k are not published later, nor any again.
class ReferenceResponder {
 public:
  /// An empty range has last < first.
  struct Range {
    std::int64_t first = 0;
    std::int64_t last = -1;
  };
  struct Answer {
    Verdict verdict = Verdict::fresh;
    Range compute;  ///< compute these in order, publish each and tell `on_computed`
    Range repeat;   ///< publish `kept` of these again
  };

  ReferenceResponder(std::int64_t num_ticks, std::size_t longest_reference, bool realtime = false)
      : num_ticks_(num_ticks),
        realtime_(realtime),
        ring_(std::array{MessageRing::digest_only, longest_reference}) {}

  Answer on_tick(std::int64_t tick, std::span<const std::byte> bytes);

  /// @throw std::logic_error unless `tick` is the one after the last, or in realtime a later one.
  void on_computed(std::int64_t tick, std::span<const std::byte> bytes);

  /// In lockstep.
  [[nodiscard]] std::span<const std::byte> kept(std::int64_t tick) const;
  /// Newest tick whose reference is computed; -1 before the first.
  [[nodiscard]] std::int64_t newest() const { return newest_; }

 private:
  enum Kind : int { tick_kind, reference_kind };

  std::int64_t num_ticks_;
  bool realtime_;
  std::int64_t newest_ = -1;
  MessageRing ring_;
};

/// The controller's inputs.
enum LawInput : int { measurement_input, reference_input, num_law_inputs };

/// The controller's side in lockstep: a measurement asks for the command and controller state of
/// its tick; they are computed once, strictly in order, as soon as the tick's reference is there
/// too. A measurement that comes again is answered with what is kept.
class CommandResponder {
 public:
  enum class Action { nothing, compute, repeat };
  struct Answer {
    Verdict verdict = Verdict::fresh;
    /// compute: the law's step of tick `next()`, publish both messages and tell `on_computed`.
    /// repeat: publish the kept messages of the measurement's tick again.
    Action action = Action::nothing;
  };

  CommandResponder(std::int64_t num_ticks, std::size_t longest_command, std::size_t longest_state)
      : num_ticks_(num_ticks),
        ring_(std::array{MessageRing::digest_only, MessageRing::digest_only, longest_command,
                         longest_state}) {}

  Answer on_input(LawInput input, std::int64_t tick, std::span<const std::byte> bytes);

  /// Tick whose command is the next to be computed.
  [[nodiscard]] std::int64_t next() const { return next_; }
  /// Returns whether the run's last tick is computed.
  [[nodiscard]] bool is_all_computed() const { return next_ == num_ticks_; }
  /// Returns whether both inputs of that tick are there.
  [[nodiscard]] bool is_ready() const;

  /// The replies of tick `next()`.
  void on_computed(std::span<const std::byte> command, std::span<const std::byte> state);

  [[nodiscard]] std::span<const std::byte> command(std::int64_t tick) const;
  [[nodiscard]] std::span<const std::byte> state(std::int64_t tick) const;

 private:
  enum Kind : int { command_kind = num_law_inputs, state_kind };

  std::int64_t num_ticks_;
  std::int64_t next_ = 0;
  MessageRing ring_;
};

/// Which ticks can have begun, as a process other than the plant can tell: one begins each period,
/// so a message of a tick far ahead is not of this run. Counts from the first tick that it is
/// given, whose message may have been late by more than `slack`: so a refusal is certain only for
/// senders that are not members.
class Pace {
 public:
  /// By how much more than the others the first message may have been delayed.
  static constexpr std::chrono::milliseconds slack{200};

  explicit Pace(double period_s) : period_s_(period_s) {}

  /// Returns whether `tick` can have begun by `now`.
  bool possible(std::int64_t tick, base::Clock::time_point now);

  /// Returns whether no tick is to come: the run's last tick is the `newest` received, or it must
  /// have begun by now, since its message may be lost.
  [[nodiscard]] bool over(std::int64_t newest, std::int64_t last,
                          base::Clock::time_point now) const;

 private:
  /// Since the first tick shown.
  [[nodiscard]] double periods_until(base::Clock::time_point now) const;

  struct First {
    std::int64_t tick = 0;
    base::Clock::time_point at;
  };

  double period_s_;
  std::optional<First> first_;
};

/// The controller's side in realtime: chooses the newest tick whose measurement and reference are
/// both there, once. Ticks may be skipped, and a skipped one is not computed later.
class CommandPicker {
 public:
  explicit CommandPicker(std::int64_t num_ticks)
      : num_ticks_(num_ticks),
        ring_(std::array{MessageRing::digest_only, MessageRing::digest_only}) {}

  Verdict on_input(LawInput input, std::int64_t tick, std::span<const std::byte> bytes);

  /// The tick to compute now; nothing when there is none newer than the last one.
  [[nodiscard]] std::optional<std::int64_t> due() const;
  /// The command of `tick`, which was due, is computed.
  void on_acted(std::int64_t tick);

 private:
  std::int64_t num_ticks_;
  std::int64_t last_ = -1;    ///< newest tick computed
  std::int64_t newest_ = -1;  ///< newest measurement
  MessageRing ring_;
};

/// The plant's side in realtime: accepts a command only within its tick, counts the ticks without a
/// command and reports when too many in a row had none. Does not hold the torque or stop the robot:
/// the plant does.
class MissedCommandMonitor {
 public:
  /// @param max_missed commands that may be missed in a row
  explicit MissedCommandMonitor(int max_missed)
      : max_missed_(max_missed), commands_(std::array{MessageRing::digest_only}) {}

  void begin(std::int64_t tick);

  /// A command of this run. `fresh`: the first of the present tick; `too_old`: of a tick that is
  /// over; `not_asked`: of a tick that has not begun.
  Verdict on_command(std::int64_t tick, std::span<const std::byte> bytes);
  /// Returns whether this tick's command was received.
  [[nodiscard]] bool is_commanded() const { return commanded_; }

  /// The tick is over.
  void end();

  [[nodiscard]] std::int64_t missed() const { return missed_; }  ///< ticks without a command
  [[nodiscard]] std::int64_t missed_in_a_row() const { return in_a_row_; }  ///< at present
  [[nodiscard]] std::int64_t longest_miss() const { return longest_; }      ///< most in a row
  /// Returns whether more than `max_missed` commands in a row were missed: the protective stop is
  /// due.
  [[nodiscard]] bool has_missed_too_many() const { return in_a_row_ > max_missed_; }

 private:
  int max_missed_;
  MessageRing commands_;
  std::int64_t tick_ = -1;
  bool commanded_ = false;
  std::int64_t missed_ = 0;
  std::int64_t in_a_row_ = 0;
  std::int64_t longest_ = 0;
};

}  // namespace tachless::session

#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "base/clock.h"
#include "session/message_ring.h"

/// Tick protocol of the processes: the reference in both modes, the controller in both modes, and
/// the plant in realtime. In lockstep every request is answered once, in order. The reply is kept
/// for repeated requests (the plant's side: tick_master.h). In realtime no process repeats a
/// message or waits for one.
namespace tachless::session {

/// The reference's side. TICK(k) requests every unpublished reference up to k + 1. No process
/// therefore waits for the reference, and TICK(k + 1) makes up for a lost TICK(k). In lockstep a
/// repeated TICK is answered with the same bytes. In realtime no reference is repeated, and
/// references before k are skipped.
class ReferenceResponder {
 public:
  /// Range of ticks; an empty one has last < first.
  struct Range {
    std::int64_t first = 0;
    std::int64_t last = -1;
  };
  struct Answer {
    Receipt receipt = Receipt::fresh;
    Range compute;  ///< compute these in order, publish each and call `on_computed`
    Range repeat;   ///< publish `kept` of these again
  };

  ReferenceResponder(std::int64_t num_ticks, std::size_t longest_reference, bool realtime = false)
      : num_ticks_(num_ticks),
        realtime_(realtime),
        ring_(std::array{MessageRing::digest_only, longest_reference}) {}

  /// Handles TICK of this run.
  Answer on_tick(std::int64_t tick, std::span<const std::byte> bytes);

  /// Keeps the reference of `tick`.
  /// @throw std::logic_error unless `tick` follows the last one; in realtime any later tick is
  /// allowed.
  void on_computed(std::int64_t tick, std::span<const std::byte> bytes);

  /// Returns the kept reference's bytes; only in lockstep.
  [[nodiscard]] std::span<const std::byte> kept(std::int64_t tick) const;
  /// Returns the newest tick with a computed reference; -1 before the first.
  [[nodiscard]] std::int64_t newest() const { return newest_; }

 private:
  enum Kind : int { tick_kind, reference_kind };

  std::int64_t num_ticks_;
  bool realtime_;
  std::int64_t newest_ = -1;
  MessageRing ring_;
};

/// Inputs of the controller.
enum LawInput : int { measurement_input, reference_input, num_law_inputs };

/// The controller's side in lockstep. A measurement requests the command and the controller state
/// of its tick. They are computed once, strictly in order, as soon as the tick's reference has
/// arrived too. A repeated measurement is answered with the kept messages.
class CommandResponder {
 public:
  enum class Action { nothing, compute, repeat };
  struct Answer {
    Receipt receipt = Receipt::fresh;
    /// compute: step the law over tick `next()`, publish both messages and call `on_computed`.
    /// repeat: publish the kept messages of the measurement's tick again.
    Action action = Action::nothing;
  };

  CommandResponder(std::int64_t num_ticks, std::size_t longest_command, std::size_t longest_state)
      : num_ticks_(num_ticks),
        ring_(std::array{MessageRing::digest_only, MessageRing::digest_only, longest_command,
                         longest_state}) {}

  /// Handles a measurement or reference of this run.
  Answer on_input(LawInput input, std::int64_t tick, std::span<const std::byte> bytes);

  /// Returns the tick whose command is computed next.
  [[nodiscard]] std::int64_t next() const { return next_; }
  /// Returns whether the run's last tick is computed.
  [[nodiscard]] bool is_all_computed() const { return next_ == num_ticks_; }
  /// Returns whether both inputs of tick `next()` have arrived.
  [[nodiscard]] bool is_ready() const;

  /// Keeps the replies of tick `next()`.
  void on_computed(std::span<const std::byte> command, std::span<const std::byte> state);

  [[nodiscard]] std::span<const std::byte> command(std::int64_t tick) const;
  [[nodiscard]] std::span<const std::byte> state(std::int64_t tick) const;

 private:
  enum Kind : int { command_kind = num_law_inputs, state_kind };

  std::int64_t num_ticks_;
  std::int64_t next_ = 0;
  MessageRing ring_;
};

/// Estimator of the ticks that can have begun, for a process other than the plant. One tick begins
/// each period, so a message of a tick far ahead is not of this run. It counts from the first given
/// tick, whose message may have been late by more than `slack`. A refusal is therefore certain only
/// for senders that are not members.
class Pace {
 public:
  /// Time by which the first message may have been delayed more than the others.
  static constexpr std::chrono::milliseconds slack{200};

  explicit Pace(double period_s) : period_s_(period_s) {}

  /// Returns whether `tick` can have begun by `now`.
  bool possible(std::int64_t tick, base::Clock::time_point now);

  /// Returns whether no further tick will come. Either the run's last tick is the `newest` received
  /// one, or it must have begun by now and its message may be lost.
  [[nodiscard]] bool over(std::int64_t newest, std::int64_t last,
                          base::Clock::time_point now) const;

 private:
  /// Returns the number of periods since the first given tick.
  [[nodiscard]] double periods_until(base::Clock::time_point now) const;

  struct First {
    std::int64_t tick = 0;
    base::Clock::time_point at;
  };

  double period_s_;
  std::optional<First> first_;
};

/// The controller's side in realtime. It chooses the newest tick whose measurement and reference
/// have both arrived, once. Ticks may be skipped, and a skipped tick is not computed later.
class CommandPicker {
 public:
  explicit CommandPicker(std::int64_t num_ticks)
      : num_ticks_(num_ticks),
        ring_(std::array{MessageRing::digest_only, MessageRing::digest_only}) {}

  Receipt on_input(LawInput input, std::int64_t tick, std::span<const std::byte> bytes);

  /// Returns the tick to compute now; nullopt if none is newer than the last one.
  [[nodiscard]] std::optional<std::int64_t> due() const;
  /// Notes that the command of `tick`, which was due, has been computed.
  void on_acted(std::int64_t tick);

 private:
  std::int64_t num_ticks_;
  std::int64_t last_ = -1;    ///< newest tick computed
  std::int64_t newest_ = -1;  ///< newest measurement
  MessageRing ring_;
};

/// The plant's side in realtime. It accepts a command only within its tick and counts the ticks
/// without a command. It reports when too many consecutive ticks had none. The plant, not this
/// class, holds the torque and stops the robot.
class MissedCommandMonitor {
 public:
  /// @param max_missed allowed number of consecutive missed commands
  explicit MissedCommandMonitor(int max_missed)
      : max_missed_(max_missed), commands_(std::array{MessageRing::digest_only}) {}

  /// Begins a tick.
  void begin(std::int64_t tick);

  /// Handles a command of this run.
  /// @return `fresh`: the first of the present tick; `too_old`: of a past tick; `not_asked`: of a
  /// tick that has not begun
  Receipt on_command(std::int64_t tick, std::span<const std::byte> bytes);
  /// Returns whether this tick's command was received.
  [[nodiscard]] bool is_commanded() const { return commanded_; }

  /// Ends the tick.
  void end();
  /// Counts ticks that passed before the next `begin` as ticks without a command.
  void skip(std::int64_t ticks);

  /// Returns the number of ticks without a command.
  [[nodiscard]] std::int64_t missed() const { return missed_; }
  /// Returns the number of consecutive ticks without a command up to now.
  [[nodiscard]] std::int64_t missed_in_a_row() const { return in_a_row_; }
  /// Returns the greatest number of consecutive ticks without a command.
  [[nodiscard]] std::int64_t longest_miss() const { return longest_; }
  /// Returns whether more than `max_missed` consecutive commands were missed; the protective stop
  /// is then due.
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

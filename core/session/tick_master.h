#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "base/clock.h"
#include "base/tick_ring.h"
#include "session/message_ring.h"

namespace tachless::session {

/// The plant's side of the protocol. In each tick the plant publishes a request (TICK and
/// measurement), repeats it until the command is received, advances, and publishes TRUTH. The run
/// ends with the logger's last acknowledgement. The class decides when the next of these actions
/// may happen, which messages to repeat and when, and when to give up.
class TickMaster {
 public:
  using Time = base::Clock::time_point;

  struct Config {
    std::int64_t num_ticks = 0;
    /// Greatest number of begun ticks that the logger has not acknowledged.
    int window = 48;
    /// A request is repeated after the first timeout (docs/decisions/0005-repeats.md),
    /// `fast_repeats` times. After that each timeout is twice as long, up to the longest.
    std::chrono::nanoseconds first_timeout = std::chrono::milliseconds(1);
    std::chrono::nanoseconds longest_timeout = std::chrono::milliseconds(320);
    int fast_repeats = 8;
    /// A peer is lost after this long without progress.
    std::chrono::nanoseconds give_up = std::chrono::seconds(5);
  };

  /// A message, or the messages of one tick, to send again.
  struct Repeat {
    enum class What {
      request,  ///< TICK and measurement
      all,      ///< TICK, measurement and TRUTH, because the logger misses one of them
    };
    What what = What::request;
    std::int64_t tick = -1;
  };

  enum class Waiting { nothing, command, logger_for_window, logger_for_end };

  /// @throw std::logic_error if the window exceeds the number of ticks that the other roles keep.
  explicit TickMaster(const Config& config);

  /// Returns whether tick `next_tick()` may begin.
  [[nodiscard]] bool may_begin() const;
  [[nodiscard]] std::int64_t next_tick() const { return next_tick_; }

  /// Notes that the request of tick `next_tick()` has been published for the first time.
  void on_asked(Time now);

  /// Handles a command of this run. `fresh`: of the present tick.
  Receipt on_command(std::int64_t tick, std::span<const std::byte> bytes, Time now);
  [[nodiscard]] bool is_commanded() const { return asking_ && commanded_; }
  /// Returns the time from the first request of the newest commanded tick to its command.
  [[nodiscard]] std::chrono::nanoseconds round_trip() const { return round_trip_; }

  /// Notes that TRUTH of the present tick has been published, which ends the tick.
  void on_completed(Time now);

  /// Handles the logger's acknowledgement. `not_asked`: of a tick that is not completed.
  Receipt on_ack(std::int64_t tick, std::uint64_t missing, Time now);
  [[nodiscard]] std::int64_t acknowledged() const { return acknowledged_; }

  /// Returns the next message to repeat now. Call it until it returns nullopt, and again at
  /// `deadline` or 0.1 s later, whichever is earlier. Time for which this process was suspended
  /// does not count as lack of progress.
  std::optional<Repeat> next_repeat(Time now);

  /// Returns the time at which to call `next_repeat` and `has_given_up` again if no message is
  /// received.
  [[nodiscard]] Time deadline() const;

  [[nodiscard]] Waiting waiting() const;
  /// Returns whether `Config::give_up` has passed without progress.
  [[nodiscard]] bool has_given_up(Time now) const;
  /// Returns whether the logger was heard since the last progress; if so, another peer is lost.
  [[nodiscard]] bool has_heard_logger() const { return logger_heard_; }

  /// Returns whether all ticks are completed and acknowledged.
  [[nodiscard]] bool is_finished() const;

 private:
  void progress(Time now);

  void remember_missing(std::uint64_t missing, Time now);

  [[nodiscard]] std::int64_t last_completed() const { return next_tick_ - 1; }
  [[nodiscard]] std::int64_t last_asked() const { return asking_ ? next_tick_ : next_tick_ - 1; }

  Config config_;
  MessageRing commands_;
  std::int64_t next_tick_ = 0;
  bool asking_ = false;
  bool commanded_ = false;
  bool logger_heard_ = false;
  std::int64_t acknowledged_ = -1;
  std::uint64_t missing_ = 0;  ///< bit i: the logger misses a message of acknowledged_ + 1 + i
  std::uint64_t pending_ = 0;  ///< the ticks of `missing_` to be repeated now
  /// Time at which all messages of a tick were last sent.
  base::TickRing<Time> sent_{MessageRing::depth};
  Time progress_;
  Time waited_;  ///< progress_, increased by the time suspended
  Time looked_;  ///< last call of next_repeat
  Time repeat_at_;
  std::chrono::nanoseconds timeout_{};
  int repeats_ = 0;  ///< since the last progress
  std::chrono::nanoseconds round_trip_{};
};

}  // namespace tachless::session

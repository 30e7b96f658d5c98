#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "loop/clock.h"
#include "protocol/lockstep/message_ring.h"
#include "protocol/lockstep/verdict.h"

namespace tachless::protocol::lockstep {

/// The plant's side of the protocol. A run is: RUN_INFO until the logger has acknowledged it; then
/// for each tick a request (TICK and measurement) until the command is received, an advance of the
/// plant, the TRUTH; at the end the logger's last acknowledgement. Decides when the next of these
/// may happen, what to repeat when, and when to give up.
class TickMaster {
 public:
  struct Config {
    std::int64_t num_ticks = 0;
    /// Most ticks that may have begun without being acknowledged by the logger.
    int window = 48;
    /// A request is repeated after the time that replies usually take, within these bounds
    /// (docs/decisions/0005-repeats.md), `patience` times; then after twice as long each time, up
    /// to the longest.
    std::chrono::nanoseconds shortest_timeout = std::chrono::microseconds(500);
    std::chrono::nanoseconds first_timeout = std::chrono::milliseconds(2);
    std::chrono::nanoseconds longest_timeout = std::chrono::milliseconds(320);
    int patience = 8;
    /// A peer is lost after this long without progress.
    std::chrono::nanoseconds give_up = std::chrono::seconds(5);
  };

  /// One message, or those of one tick, to send again.
  struct Repeat {
    enum class What {
      run_info,
      question,  ///< TICK and measurement
      all,       ///< TICK, measurement and TRUTH: the logger misses something of this tick
    };
    What what = What::question;
    std::int64_t tick = -1;
  };

  enum class Waiting { nobody, logger_for_run_info, command, logger_for_window, logger_for_end };

  /// @throw std::logic_error when the window is larger than what the other roles keep.
  TickMaster(const Config& config, std::size_t longest_command);

  /// RUN_INFO has been published for the first time.
  void introduced(loop::Clock::time_point now);

  /// Whether tick `next_tick()` may begin.
  [[nodiscard]] bool may_begin() const;
  [[nodiscard]] std::int64_t next_tick() const { return next_tick_; }

  /// The request of tick `next_tick()` has been published for the first time.
  void asked(loop::Clock::time_point now);

  /// A command of this run was received. `fresh`: of the present tick.
  Verdict on_command(std::int64_t tick, std::span<const std::byte> bytes, std::string_view sender,
                     loop::Clock::time_point now);
  [[nodiscard]] bool commanded() const { return asking_ && commanded_; }
  /// From the first request of the newest commanded tick to its command.
  [[nodiscard]] std::chrono::nanoseconds round_trip() const { return round_trip_; }
  /// Who sent the command that is kept for `tick`.
  [[nodiscard]] std::string_view sender_of(std::int64_t tick) const;

  /// TRUTH of the present tick has been published; the tick is over.
  void completed(loop::Clock::time_point now);

  /// The logger's acknowledgement was received. `not_asked`: of a tick that has not begun.
  Verdict on_ack(std::int64_t tick, std::uint64_t missing, loop::Clock::time_point now);
  [[nodiscard]] std::int64_t acknowledged() const { return acknowledged_; }

  /// Another controller has taken over and has to catch up: the requests since the newest tick that
  /// it has computed are repeated, until it has commanded the newest.
  void replaced(loop::Clock::time_point now);
  /// The newest tick that it has computed, as it announces. Ignored unless it is catching up; a
  /// higher one is progress.
  void successor_at(std::int64_t tick, loop::Clock::time_point now);
  [[nodiscard]] bool catching_up() const { return successor_.has_value(); }

  /// What to repeat now; call until it returns nothing, and again by `deadline` or 0.1 s later. If
  /// this process was suspended meanwhile, that time does not count as lack of progress.
  std::optional<Repeat> next_repeat(loop::Clock::time_point now);

  /// When to call `next_repeat` and `given_up` again if no message is received.
  [[nodiscard]] loop::Clock::time_point deadline() const;

  [[nodiscard]] Waiting waiting() const;
  /// Whether `Config::give_up` has passed without progress.
  [[nodiscard]] bool given_up(loop::Clock::time_point now) const;
  /// Whether a message of the logger was received since the last progress: then another is lost.
  [[nodiscard]] bool logger_heard() const { return logger_heard_; }

  /// All ticks are completed and acknowledged.
  [[nodiscard]] bool finished() const;

 private:
  void progress(loop::Clock::time_point now);
  [[nodiscard]] std::int64_t last_completed() const;
  void note_round_trip(loop::Clock::time_point now);
  [[nodiscard]] std::int64_t last_asked() const { return asking_ ? next_tick_ : next_tick_ - 1; }
  void ask_successor();
  void remember_missing(std::uint64_t missing);

  Config config_;
  MessageRing commands_;
  std::int64_t next_tick_ = 0;
  bool introduced_ = false;
  bool asking_ = false;
  bool commanded_ = false;
  bool logger_heard_ = false;
  std::int64_t acknowledged_ = -2;
  std::uint64_t missing_ = 0;  ///< bit i: the logger misses something of acknowledged_ + 1 + i
  std::uint64_t pending_ = 0;  ///< the same, to be repeated now
  std::array<loop::Clock::time_point, MessageRing::depth>
      sent_{};  ///< last time a tick's all was sent
  loop::Clock::time_point progress_;
  loop::Clock::time_point waited_;  ///< progress_, later by the time suspended
  loop::Clock::time_point looked_;  ///< last call of next_repeat
  loop::Clock::time_point repeat_at_;
  std::chrono::nanoseconds timeout_{};
  int repeats_ = 0;                        ///< since the last progress
  std::optional<std::int64_t> successor_;  ///< newest tick of a controller that is catching up
  std::int64_t ask_again_ = 0;             ///< first tick to request of it again now
  std::int64_t ask_again_last_ = -1;       ///< last one
  std::chrono::nanoseconds round_trip_{};
  std::chrono::nanoseconds usual_{}, deviation_{};  ///< of round trips, smoothed
};

}  // namespace tachless::protocol::lockstep

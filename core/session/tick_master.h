#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <stdexcept>
#include <utility>

#include "base/clock.h"
#include "session/message_ring.h"

namespace tachless::session {

/// The plant's side of the protocol. A run is: for each tick a request (TICK and measurement) until
/// the command is received, an advance of the plant, the TRUTH; at the end the logger's last
/// acknowledgement. Decides when the next of these may happen, what to repeat when, and when to
/// give up.
class TickMaster {
 public:
  using Time = base::Clock::time_point;

  struct Config {
    std::int64_t num_ticks = 0;
    /// Most ticks that may have begun without being acknowledged by the logger.
    int window = 48;
    /// A request is repeated after the first timeout (docs/decisions/0005-repeats.md),
    /// `fast_repeats` times; then after twice as long each time, up to the longest.
    std::chrono::nanoseconds first_timeout = std::chrono::milliseconds(1);
    std::chrono::nanoseconds longest_timeout = std::chrono::milliseconds(320);
    int fast_repeats = 8;
    /// A peer is lost after this long without progress.
    std::chrono::nanoseconds give_up = std::chrono::seconds(5);
  };

  /// One message, or those of one tick, to send again.
  struct Repeat {
    enum class What {
      request,  ///< TICK and measurement
      all,      ///< TICK, measurement and TRUTH: the logger misses something of this tick
    };
    What what = What::request;
    std::int64_t tick = -1;
  };

  enum class Waiting { nothing, command, logger_for_window, logger_for_end };

  /// @throw std::logic_error when the window is larger than what the other roles keep.
  explicit TickMaster(const Config& config)
      : config_(config),
        commands_(std::array{MessageRing::digest_only}),
        repeat_at_(Time::max()),
        timeout_(config.first_timeout) {
    // The reference is two ticks ahead of the oldest that may have to be repeated.
    if (config.window < 1 || config.window > MessageRing::depth - 2) {
      throw std::logic_error("lockstep window does not fit the messages kept");
    }
  }

  /// Whether tick `next_tick()` may begin.
  [[nodiscard]] bool may_begin() const {
    return !asking_ && next_tick_ < config_.num_ticks &&
           next_tick_ - acknowledged_ <= config_.window;
  }
  [[nodiscard]] std::int64_t next_tick() const { return next_tick_; }

  /// The request of tick `next_tick()` has been published for the first time.
  void asked(Time now) {
    if (!may_begin()) throw std::logic_error("a tick was begun that may not begin");
    asking_ = true;
    commanded_ = false;
    progress(now);
  }

  /// A command of this run was received. `fresh`: of the present tick.
  Verdict on_command(std::int64_t tick, std::span<const std::byte> bytes, Time now) {
    if (tick < 0 || tick > last_asked()) return Verdict::not_asked;
    if (tick <= last_asked() - MessageRing::depth) return Verdict::too_old;
    const Verdict verdict = commands_.put(tick, 0, bytes);
    if (verdict == Verdict::fresh) {
      commanded_ = true;
      round_trip_ = now - progress_;
    }
    return verdict;
  }
  [[nodiscard]] bool commanded() const { return asking_ && commanded_; }
  /// From the first request of the newest commanded tick to its command.
  [[nodiscard]] std::chrono::nanoseconds round_trip() const { return round_trip_; }

  /// TRUTH of the present tick has been published; the tick is over.
  void completed(Time now) {
    if (!commanded()) throw std::logic_error("a tick was completed without its command");
    sent(next_tick_) = now;
    asking_ = false;
    ++next_tick_;
    progress(now);
  }

  /// The logger's acknowledgement was received. `not_asked`: of a tick that has not begun.
  Verdict on_ack(std::int64_t tick, std::uint64_t missing, Time now) {
    if (tick < -1 || tick > last_completed()) return Verdict::not_asked;
    if (tick < acknowledged_) return Verdict::too_old;
    const bool advanced = tick > acknowledged_;
    acknowledged_ = tick;
    remember_missing(missing, now);
    if (!asking_ && advanced) progress(now);
    if (!asking_ && !advanced) {
      repeats_ = 0;
      timeout_ = config_.first_timeout;
      repeat_at_ = std::min(repeat_at_, now + timeout_);
    }
    logger_heard_ = true;
    return Verdict::fresh;
  }
  [[nodiscard]] std::int64_t acknowledged() const { return acknowledged_; }

  /// What to repeat now; call until it returns nothing, and again by `deadline` or 0.1 s later. If
  /// this process was suspended meanwhile, that time does not count as lack of progress.
  std::optional<Repeat> next_repeat(Time now) {
    const auto unlooked = now - std::exchange(looked_, now);
    if (unlooked > 2 * config_.longest_timeout) waited_ = std::min(now, waited_ + unlooked);
    const Waiting waiting_for = waiting();
    if (now >= repeat_at_ && waiting_for == Waiting::nothing) repeat_at_ = Time::max();
    if (now >= repeat_at_) {
      if (++repeats_ >= config_.fast_repeats) {
        timeout_ = std::min(2 * timeout_, config_.longest_timeout);
      }
      repeat_at_ = now + timeout_;
      if (waiting_for == Waiting::command) return Repeat{Repeat::What::request, next_tick_};
      // After the oldest tick the logger reports what else it misses.
      pending_ |= missing_ | 1;
    }
    if (pending_ == 0) return std::nullopt;
    const std::int64_t tick = acknowledged_ + 1 + std::countr_zero(pending_);
    pending_ &= pending_ - 1;
    sent(tick) = now;
    return Repeat{Repeat::What::all, tick};
  }

  /// When to call `next_repeat` and `given_up` again if no message is received.
  [[nodiscard]] Time deadline() const {
    if (pending_ != 0) return Time::min();
    if (waiting() == Waiting::nothing) return Time::max();
    return std::min(repeat_at_, waited_ + config_.give_up);
  }

  [[nodiscard]] Waiting waiting() const {
    if (finished()) return Waiting::nothing;
    if (asking_) return commanded_ ? Waiting::nothing : Waiting::command;
    if (next_tick_ == config_.num_ticks) return Waiting::logger_for_end;
    return may_begin() ? Waiting::nothing : Waiting::logger_for_window;
  }
  /// Whether `Config::give_up` has passed without progress.
  [[nodiscard]] bool given_up(Time now) const {
    return waiting() != Waiting::nothing && now - waited_ >= config_.give_up;
  }
  /// Whether a message of the logger was received since the last progress: then another is lost.
  [[nodiscard]] bool logger_heard() const { return logger_heard_; }

  /// All ticks are completed and acknowledged.
  [[nodiscard]] bool finished() const {
    return !asking_ && next_tick_ == config_.num_ticks && acknowledged_ == config_.num_ticks - 1;
  }

 private:
  void progress(Time now) {
    progress_ = waited_ = now;
    logger_heard_ = false;
    repeats_ = 0;
    timeout_ = config_.first_timeout;
    repeat_at_ = now + timeout_;
  }

  void remember_missing(std::uint64_t missing, Time now) {
    // Only completed ticks: the current one is repeated until its command is in anyway.
    const std::int64_t completed_after = last_completed() - acknowledged_;
    missing_ = missing;
    if (completed_after < 64) missing_ &= (std::uint64_t{1} << completed_after) - 1;
    pending_ = 0;
    // What was sent a moment ago may still be on its way.
    const auto settled = config_.first_timeout / 2;
    for (std::uint64_t rest = missing_; rest != 0; rest &= rest - 1) {
      const std::int64_t late = acknowledged_ + 1 + std::countr_zero(rest);
      if (now - sent(late) >= settled) pending_ |= rest & -rest;
    }
  }

  /// When all messages of a tick were last sent.
  Time& sent(std::int64_t tick) {
    return sent_[static_cast<std::size_t>(tick % MessageRing::depth)];
  }
  [[nodiscard]] std::int64_t last_completed() const { return next_tick_ - 1; }
  [[nodiscard]] std::int64_t last_asked() const { return asking_ ? next_tick_ : next_tick_ - 1; }

  Config config_;
  MessageRing commands_;
  std::int64_t next_tick_ = 0;
  bool asking_ = false;
  bool commanded_ = false;
  bool logger_heard_ = false;
  std::int64_t acknowledged_ = -1;
  std::uint64_t missing_ = 0;  ///< bit i: the logger misses something of acknowledged_ + 1 + i
  std::uint64_t pending_ = 0;  ///< the same, to be repeated now
  std::array<Time, MessageRing::depth> sent_{};
  Time progress_;
  Time waited_;  ///< progress_, later by the time suspended
  Time looked_;  ///< last call of next_repeat
  Time repeat_at_;
  std::chrono::nanoseconds timeout_{};
  int repeats_ = 0;  ///< since the last progress
  std::chrono::nanoseconds round_trip_{};
};

}  // namespace tachless::session

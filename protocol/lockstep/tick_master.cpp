#include "protocol/lockstep/tick_master.h"

#include <algorithm>
#include <bit>
#include <stdexcept>
#include <utility>

namespace tachless::protocol::lockstep {

TickMaster::TickMaster(const Config& config, std::size_t longest_command)
    : config_(config),
      commands_(std::array{longest_command}),
      repeat_at_(loop::Clock::time_point::max()),
      timeout_(config.first_timeout) {
  // The reference is two ticks ahead of the oldest that may have to be repeated.
  if (config.window < 1 || config.window > MessageRing::depth - 2) {
    throw std::logic_error("lockstep window does not fit the messages kept");
  }
}

void TickMaster::progress(loop::Clock::time_point now) {
  progress_ = waited_ = now;
  logger_heard_ = false;
  repeats_ = 0;
  timeout_ = config_.first_timeout;
  if (asking_ && usual_.count() != 0) {
    timeout_ = std::clamp(usual_ + 4 * deviation_, config_.shortest_timeout, config_.first_timeout);
  }
  repeat_at_ = now + timeout_;
}

std::int64_t TickMaster::last_completed() const { return next_tick_ - 1; }

void TickMaster::introduced(loop::Clock::time_point now) {
  introduced_ = true;
  progress(now);
}

bool TickMaster::may_begin() const {
  return !asking_ && acknowledged_ >= -1 && next_tick_ < config_.num_ticks &&
         next_tick_ - acknowledged_ <= config_.window;
}

void TickMaster::asked(loop::Clock::time_point now) {
  if (!may_begin()) throw std::logic_error("a tick was begun that may not begin");
  asking_ = true;
  commanded_ = false;
  progress(now);
}

Verdict TickMaster::on_command(std::int64_t tick, std::span<const std::byte> bytes,
                               std::string_view sender, loop::Clock::time_point now) {
  const std::int64_t newest = asking_ ? next_tick_ : last_completed();
  if (tick < 0 || tick > newest) return Verdict::not_asked;
  if (tick <= newest - MessageRing::depth) return Verdict::too_old;
  const Verdict verdict = commands_.put(tick, 0, bytes, sender);
  if (verdict == Verdict::fresh) {
    commanded_ = true;
    successor_.reset();
    ask_again_last_ = -1;
    note_round_trip(now);
  }
  return verdict;
}

void TickMaster::note_round_trip(loop::Clock::time_point now) {
  round_trip_ = now - progress_;
  // An answer after a repetition tells more about the loss than about the way (Karn's rule); the
  // smoothing is that of RFC 6298.
  if (repeats_ > 0) return;
  if (usual_.count() == 0) {
    usual_ = round_trip_;
    deviation_ = round_trip_ / 2;
  } else {
    deviation_ += (std::chrono::abs(round_trip_ - usual_) - deviation_) / 4;
    usual_ += (round_trip_ - usual_) / 8;
  }
}

std::string_view TickMaster::sender_of(std::int64_t tick) const {
  return commands_.sender(tick, 0);
}

void TickMaster::completed(loop::Clock::time_point now) {
  if (!commanded()) throw std::logic_error("a tick was completed without its command");
  sent_[static_cast<std::size_t>(next_tick_ % MessageRing::depth)] = now;
  asking_ = false;
  ++next_tick_;
  progress(now);
}

void TickMaster::remember_missing(std::uint64_t missing) {
  // Only completed ticks: the current one is repeated until its command is in anyway. A logger
  // without RUN_INFO may have heard of ticks, from a stranger, but there are none.
  const std::int64_t completed_after = acknowledged_ < -1 ? 0 : last_completed() - acknowledged_;
  if (completed_after <= 0) {
    missing_ = 0;
  } else if (completed_after >= 64) {
    missing_ = missing;
  } else {
    missing_ = missing & ((std::uint64_t{1} << completed_after) - 1);
  }
}

Verdict TickMaster::on_ack(std::int64_t tick, std::uint64_t missing, loop::Clock::time_point now) {
  if (!introduced_ || tick < -2 || tick > last_completed()) return Verdict::not_asked;
  if (tick < acknowledged_) return Verdict::too_old;
  logger_heard_ = true;
  const bool advanced = tick > acknowledged_;
  acknowledged_ = tick;
  remember_missing(missing);
  pending_ = 0;
  // What was sent a moment ago may still be on its way.
  const auto settled = config_.first_timeout / 2;
  for (std::uint64_t rest = missing_; rest != 0; rest &= rest - 1) {
    const std::int64_t late = acknowledged_ + 1 + std::countr_zero(rest);
    if (now - sent_[static_cast<std::size_t>(late % MessageRing::depth)] >= settled) {
      pending_ |= rest & -rest;
    }
  }
  if (!asking_) {
    if (advanced) {
      progress(now);
      logger_heard_ = true;
    } else {
      repeats_ = 0;
      timeout_ = config_.first_timeout;
      repeat_at_ = std::min(repeat_at_, now + timeout_);
    }
  }
  return Verdict::fresh;
}

void TickMaster::replaced(loop::Clock::time_point now) {
  successor_ = -1;
  progress(now);
}

void TickMaster::successor_at(std::int64_t tick, loop::Clock::time_point now) {
  if (!successor_ || tick <= *successor_) return;
  successor_ = tick;
  progress(now);
  repeat_at_ = now;
}

void TickMaster::ask_successor() {
  // While it is rebuilding its memory from the log it is further behind than we can repeat.
  const std::int64_t oldest_kept = last_asked() - MessageRing::depth + 1;
  if (*successor_ + 1 < oldest_kept) return;
  // The command of the newest tick may be lost though the successor has computed it.
  ask_again_ = std::min(*successor_ + 1, last_asked());
  ask_again_last_ = last_asked();
}

std::optional<TickMaster::Repeat> TickMaster::next_repeat(loop::Clock::time_point now) {
  const auto unlooked = now - std::exchange(looked_, now);
  if (unlooked > 2 * config_.longest_timeout) waited_ = std::min(now, waited_ + unlooked);
  if (now >= repeat_at_) {
    const Waiting waiting_for = waiting();
    if (waiting_for == Waiting::nobody) {
      repeat_at_ = loop::Clock::time_point::max();
    } else {
      if (++repeats_ >= config_.patience)
        timeout_ = std::min(2 * timeout_, config_.longest_timeout);
      repeat_at_ = now + timeout_;
      if (waiting_for == Waiting::logger_for_run_info) return Repeat{Repeat::What::run_info, -1};
      if (successor_) {
        ask_successor();
      } else if (waiting_for == Waiting::command) {
        return Repeat{Repeat::What::question, next_tick_};
      }
      // The oldest tick makes the logger say what else it misses.
      if (waiting_for != Waiting::command) pending_ |= missing_ | 1;
    }
  }
  if (ask_again_ <= ask_again_last_) return Repeat{Repeat::What::question, ask_again_++};
  if (pending_ == 0) return std::nullopt;
  const std::int64_t tick = acknowledged_ + 1 + std::countr_zero(pending_);
  pending_ &= pending_ - 1;
  sent_[static_cast<std::size_t>(tick % MessageRing::depth)] = now;
  return Repeat{Repeat::What::all, tick};
}

loop::Clock::time_point TickMaster::deadline() const {
  if (pending_ != 0 || ask_again_ <= ask_again_last_) return loop::Clock::time_point::min();
  return waiting() == Waiting::nobody ? loop::Clock::time_point::max()
                                      : std::min(repeat_at_, waited_ + config_.give_up);
}

TickMaster::Waiting TickMaster::waiting() const {
  if (!introduced_ || finished()) return Waiting::nobody;
  if (acknowledged_ < -1) return Waiting::logger_for_run_info;
  if (asking_) return commanded_ ? Waiting::nobody : Waiting::command;
  if (next_tick_ == config_.num_ticks) return Waiting::logger_for_end;
  return may_begin() ? Waiting::nobody : Waiting::logger_for_window;
}

bool TickMaster::given_up(loop::Clock::time_point now) const {
  return waiting() != Waiting::nobody && now - waited_ >= config_.give_up;
}

bool TickMaster::finished() const {
  return introduced_ && !asking_ && next_tick_ == config_.num_ticks &&
         acknowledged_ == config_.num_ticks - 1;
}

}  // namespace tachless::protocol::lockstep

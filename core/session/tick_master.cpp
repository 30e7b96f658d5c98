#include "session/tick_master.h"

#include <algorithm>
#include <array>
#include <bit>
#include <stdexcept>
#include <utility>

namespace tachless::session {

TickMaster::TickMaster(const Config& config)
    : config_(config),
      commands_(std::array{MessageRing::digest_only}),
      repeat_at_(Time::max()),
      timeout_(config.first_timeout) {
  // The reference is two ticks ahead of the oldest tick that may have to be repeated.
  if (config.window < 1 || config.window > MessageRing::depth - 2) {
    throw std::logic_error("lockstep window does not fit the messages kept");
  }
}

bool TickMaster::may_begin() const {
  return !asking_ && next_tick_ < config_.num_ticks && next_tick_ - acknowledged_ <= config_.window;
}

void TickMaster::on_asked(Time now) {
  if (!may_begin()) throw std::logic_error("a tick was begun that may not begin");
  asking_ = true;
  commanded_ = false;
  progress(now);
}

Receipt TickMaster::on_command(std::int64_t tick, std::span<const std::byte> bytes, Time now) {
  if (tick < 0 || tick > last_asked()) return Receipt::not_asked;
  if (tick <= last_asked() - MessageRing::depth) return Receipt::too_old;
  const Receipt receipt = commands_.put(tick, 0, bytes);
  if (receipt == Receipt::fresh) {
    commanded_ = true;
    round_trip_ = now - progress_;
  }
  return receipt;
}

void TickMaster::on_completed(Time now) {
  if (!is_commanded()) throw std::logic_error("a tick was completed without its command");
  sent_[next_tick_] = now;
  asking_ = false;
  ++next_tick_;
  progress(now);
}

Receipt TickMaster::on_ack(std::int64_t tick, std::uint64_t missing, Time now) {
  if (tick < -1 || tick > last_completed()) return Receipt::not_asked;
  if (tick < acknowledged_) return Receipt::too_old;
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
  return Receipt::fresh;
}

std::optional<TickMaster::Repeat> TickMaster::next_repeat(Time now) {
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
    // After the oldest tick, the logger reports which others it misses.
    pending_ |= missing_ | 1;
  }
  if (pending_ == 0) return std::nullopt;
  const std::int64_t tick = acknowledged_ + 1 + std::countr_zero(pending_);
  pending_ &= pending_ - 1;
  sent_[tick] = now;
  return Repeat{Repeat::What::all, tick};
}

TickMaster::Time TickMaster::deadline() const {
  if (pending_ != 0) return Time::min();
  if (waiting() == Waiting::nothing) return Time::max();
  return std::min(repeat_at_, waited_ + config_.give_up);
}

TickMaster::Waiting TickMaster::waiting() const {
  if (is_finished()) return Waiting::nothing;
  if (asking_) return commanded_ ? Waiting::nothing : Waiting::command;
  if (next_tick_ == config_.num_ticks) return Waiting::logger_for_end;
  return may_begin() ? Waiting::nothing : Waiting::logger_for_window;
}

bool TickMaster::has_given_up(Time now) const {
  return waiting() != Waiting::nothing && now - waited_ >= config_.give_up;
}

bool TickMaster::is_finished() const {
  return !asking_ && next_tick_ == config_.num_ticks && acknowledged_ == config_.num_ticks - 1;
}

void TickMaster::progress(Time now) {
  progress_ = waited_ = now;
  logger_heard_ = false;
  repeats_ = 0;
  timeout_ = config_.first_timeout;
  repeat_at_ = now + timeout_;
}

void TickMaster::remember_missing(std::uint64_t missing, Time now) {
  // Only completed ticks count; the current one is repeated until its command arrives anyway.
  const std::int64_t completed_after = last_completed() - acknowledged_;
  missing_ = missing;
  if (completed_after < 64) missing_ &= (std::uint64_t{1} << completed_after) - 1;
  pending_ = 0;
  // A message sent a moment ago may still be in transit.
  const auto settled = config_.first_timeout / 2;
  for (std::uint64_t rest = missing_; rest != 0; rest &= rest - 1) {
    const std::int64_t late = acknowledged_ + 1 + std::countr_zero(rest);
    if (now - sent_[late] >= settled) pending_ |= rest & -rest;
  }
}

}  // namespace tachless::session

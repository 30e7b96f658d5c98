#include "session/responders.h"

#include <algorithm>
#include <array>
#include <stdexcept>

namespace tachless::session {

ReferenceResponder::Answer ReferenceResponder::on_tick(std::int64_t tick,
                                                       std::span<const std::byte> bytes) {
  // In lockstep the plant begins tick k after command k - 1, which needs reference k - 1.
  if (tick < 0 || tick >= num_ticks_ || (!realtime_ && tick > newest_ + 1)) {
    return {Receipt::not_asked, {}, {}};
  }
  Answer result{ring_.put(tick, tick_kind, bytes), {}, {}};
  if (result.receipt != Receipt::fresh && result.receipt != Receipt::repeated) return result;
  const std::int64_t last = std::min(tick + 1, num_ticks_ - 1);
  result.compute = {std::max(newest_ + 1, tick), last};
  if (!realtime_ && (result.receipt == Receipt::repeated || tick + 1 <= newest_)) {
    result.repeat = {tick, std::min(last, newest_)};
  }
  return result;
}

void ReferenceResponder::on_computed(std::int64_t tick, std::span<const std::byte> bytes) {
  if (tick <= newest_ || (!realtime_ && tick > newest_ + 1)) {
    throw std::logic_error("a reference was computed out of turn");
  }
  if (!realtime_) ring_.put(tick, reference_kind, bytes);
  newest_ = tick;
}

std::span<const std::byte> ReferenceResponder::kept(std::int64_t tick) const {
  return ring_.bytes(tick, reference_kind);
}

CommandResponder::Answer CommandResponder::on_input(LawInput input, std::int64_t tick,
                                                    std::span<const std::byte> bytes) {
  const bool measured = input == measurement_input;
  // The plant is at most at tick next(), and the reference is one tick ahead of it.
  const std::int64_t newest = measured ? next_ : next_ + 1;
  if (tick < 0 || tick >= num_ticks_ || tick > newest) {
    return {Receipt::not_asked, Action::nothing};
  }
  const Receipt receipt = ring_.put(tick, input, bytes);
  if (receipt == Receipt::fresh && is_ready()) return {receipt, Action::compute};
  const bool repeat = measured && receipt == Receipt::repeated && ring_.has(tick, command_kind);
  return {receipt, repeat ? Action::repeat : Action::nothing};
}

bool CommandResponder::is_ready() const {
  return ring_.has(next_, measurement_input) && ring_.has(next_, reference_input);
}

void CommandResponder::on_computed(std::span<const std::byte> command,
                                   std::span<const std::byte> state) {
  if (!is_ready()) throw std::logic_error("a command was computed without its inputs");
  ring_.put(next_, command_kind, command);
  ring_.put(next_, state_kind, state);
  ++next_;
}

std::span<const std::byte> CommandResponder::command(std::int64_t tick) const {
  return ring_.bytes(tick, command_kind);
}

std::span<const std::byte> CommandResponder::state(std::int64_t tick) const {
  return ring_.bytes(tick, state_kind);
}

bool Pace::possible(std::int64_t tick, base::Clock::time_point now) {
  if (tick < 0) return false;
  if (!first_) first_ = First{tick, now};
  return static_cast<double>(tick - first_->tick) <= periods_until(now + slack) + 2;
}

bool Pace::over(std::int64_t newest, std::int64_t last, base::Clock::time_point now) const {
  return newest == last ||
         (first_ && static_cast<double>(last - first_->tick) <= periods_until(now));
}

double Pace::periods_until(base::Clock::time_point now) const {
  return std::chrono::duration<double>(now - first_->at).count() / period_s_;
}

Receipt CommandPicker::on_input(LawInput input, std::int64_t tick,
                                std::span<const std::byte> bytes) {
  if (tick < 0 || tick >= num_ticks_) return Receipt::not_asked;
  const Receipt receipt = ring_.put(tick, input, bytes);
  if (receipt != Receipt::fresh || input != measurement_input) return receipt;
  newest_ = std::max(newest_, tick);
  return tick > last_ ? Receipt::fresh : Receipt::too_old;
}

std::optional<std::int64_t> CommandPicker::due() const {
  // A reference one tick ahead may have replaced the tick `depth` before it in the ring.
  const std::int64_t oldest = std::max(last_ + 1, newest_ - MessageRing::depth + 2);
  for (std::int64_t tick = newest_; tick >= oldest; --tick) {
    if (ring_.has(tick, measurement_input) && ring_.has(tick, reference_input)) {
      return tick;
    }
  }
  return std::nullopt;
}

void CommandPicker::on_acted(std::int64_t tick) {
  if (tick <= last_) throw std::logic_error("a tick was acted on out of turn");
  last_ = tick;
}

void MissedCommandMonitor::begin(std::int64_t tick) {
  tick_ = tick;
  commanded_ = false;
}

Receipt MissedCommandMonitor::on_command(std::int64_t tick, std::span<const std::byte> bytes) {
  if (tick < 0 || tick > tick_) return Receipt::not_asked;
  const Receipt receipt = commands_.put(tick, 0, bytes);
  if (receipt != Receipt::fresh) return receipt;
  if (tick < tick_) return Receipt::too_old;
  commanded_ = true;
  return Receipt::fresh;
}

void MissedCommandMonitor::end() {
  if (commanded_) {
    in_a_row_ = 0;
  } else {
    skip(1);
  }
}

void MissedCommandMonitor::skip(std::int64_t ticks) {
  in_a_row_ += ticks;
  missed_ += ticks;
  longest_ = std::max(longest_, in_a_row_);
}

}  // namespace tachless::session

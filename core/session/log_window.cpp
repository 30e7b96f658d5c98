#include "session/log_window.h"

#include <algorithm>
#include <stdexcept>

namespace tachless::session {

Receipt LogWindow::on_message(Slot slot, std::int64_t tick, std::span<const std::byte> bytes) {
  // A newer tick would overwrite unwritten ticks in the ring. The plant's window prevents such
  // ticks.
  if (tick < 0 || tick >= num_ticks_ || tick > written_ + MessageRing::depth) {
    return Receipt::not_asked;
  }
  const bool late = tick + 1 < newest_;
  const Receipt receipt = ring_.put(tick, static_cast<int>(slot), bytes);
  if (receipt == Receipt::fresh) {
    if (slot != Slot::reference) newest_ = std::max(newest_, tick);
    if (late) filled_late_ = true;
  }
  // The plant repeats TRUTH last, so each repeated tick causes one acknowledgement.
  if (slot == Slot::truth && (late || receipt != Receipt::fresh)) asked_again_ = true;
  return receipt;
}

std::optional<std::int64_t> LogWindow::complete_tick() const {
  if (!is_complete(written_ + 1)) return std::nullopt;
  return written_ + 1;
}

std::span<const std::byte> LogWindow::bytes(std::int64_t tick, Slot slot) const {
  return ring_.bytes(tick, static_cast<int>(slot));
}

void LogWindow::on_written() {
  if (!complete_tick()) throw std::logic_error("an incomplete tick was written");
  ++written_;
}

std::optional<LogWindow::Ack> LogWindow::take_ack() {
  const bool due = asked_again_ || (filled_late_ && written_ > acked_.tick) ||
                   newest_ - newest_acked_ >= ack_interval ||
                   (is_all_written() && written_ > acked_.tick);
  if (!due) return std::nullopt;
  Ack ack{written_, 0};
  // Messages of the newest two ticks are probably in transit, unless the plant asks again.
  const std::int64_t last = asked_again_ ? newest_ : newest_ - 2;
  for (std::int64_t tick = written_ + 1; tick <= std::min(last, written_ + 64); ++tick) {
    if (!is_complete(tick)) ack.missing |= std::uint64_t{1} << (tick - written_ - 1);
  }
  acked_ = ack;
  newest_acked_ = newest_;
  asked_again_ = false;
  filled_late_ = false;
  return ack;
}

bool LogWindow::is_complete(std::int64_t tick) const {
  return std::ranges::all_of(messages::all_slots, [&](Slot slot) {
    return longest_[index(slot)] == 0 || ring_.has(tick, static_cast<int>(slot));
  });
}

}  // namespace tachless::session

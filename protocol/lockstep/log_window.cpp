#include "protocol/lockstep/log_window.h"

#include <algorithm>
#include <stdexcept>

namespace tachless::protocol::lockstep {

LogWindow::LogWindow(std::int64_t num_ticks, const std::array<std::size_t, num_slots>& longest)
    : num_ticks_(num_ticks), ring_(longest) {}

Verdict LogWindow::on_run_info(bool same) {
  if (introduced_ && !same) return Verdict::conflicting;
  const Verdict verdict = introduced_ ? Verdict::repeated : Verdict::fresh;
  introduced_ = true;
  asked_again_ = true;
  return verdict;
}

Verdict LogWindow::on_message(Slot slot, std::int64_t tick, std::span<const std::byte> bytes,
                              std::string_view sender) {
  // Newer ones would push out what is not yet written; the plant's window keeps it from that.
  if (tick < 0 || tick >= num_ticks_ || tick > written_ + MessageRing::depth) {
    return Verdict::not_asked;
  }
  const bool late = tick + 1 < newest_;
  const Verdict verdict = ring_.put(tick, static_cast<int>(slot), bytes, sender);
  if (verdict == Verdict::fresh) {
    if (slot != Slot::reference) newest_ = std::max(newest_, tick);
    if (late) filled_late_ = true;
  }
  // TRUTH is the last of what the plant repeats: one acknowledgement per repeated tick.
  if (slot == Slot::truth && (late || verdict != Verdict::fresh)) asked_again_ = true;
  return verdict;
}

bool LogWindow::complete(std::int64_t tick) const {
  for (int slot = 0; slot < num_slots; ++slot) {
    if (!ring_.has(tick, slot)) return false;
  }
  return true;
}

std::optional<std::int64_t> LogWindow::complete_tick() const {
  if (!introduced_ || !complete(written_ + 1)) return std::nullopt;
  return written_ + 1;
}

std::span<const std::byte> LogWindow::bytes(std::int64_t tick, Slot slot) const {
  return ring_.bytes(tick, static_cast<int>(slot));
}

std::string_view LogWindow::sender(std::int64_t tick, Slot slot) const {
  return ring_.sender(tick, static_cast<int>(slot));
}

void LogWindow::written() {
  if (!complete_tick()) throw std::logic_error("an incomplete tick was written");
  ++written_;
}

std::optional<LogWindow::Ack> LogWindow::take_ack() {
  const std::int64_t gap_free = introduced_ ? written_ : -2;
  const bool due = asked_again_ || (filled_late_ && gap_free > acked_.tick) ||
                   newest_ - newest_acked_ >= ack_interval ||
                   (gap_free == num_ticks_ - 1 && gap_free > acked_.tick);
  if (!due) return std::nullopt;
  Ack ack{gap_free, 0};
  // What belongs to the newest two ticks is probably on its way, unless the plant asks again.
  const std::int64_t last = asked_again_ ? newest_ : newest_ - 2;
  for (std::int64_t tick = written_ + 1; tick <= std::min(last, gap_free + 64); ++tick) {
    if (!complete(tick)) ack.missing |= std::uint64_t{1} << (tick - gap_free - 1);
  }
  acked_ = ack;
  newest_acked_ = newest_;
  asked_again_ = false;
  filled_late_ = false;
  return ack;
}

}  // namespace tachless::protocol::lockstep

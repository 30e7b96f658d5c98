#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <stdexcept>

#include "messages/slot.h"
#include "session/message_ring.h"

namespace tachless::session {

using messages::num_slots;
using messages::Slot;

/// The logger's side: collects the six messages of each tick in any order of arrival, gives
/// complete ticks in order, and decides when to acknowledge and what to report as missing. Writes
/// nothing.
class LogWindow {
 public:
  struct Ack {
    std::int64_t tick = -1;     ///< last without a gap; -1: none
    std::uint64_t missing = 0;  ///< bit i: tick + 1 + i has begun but is incomplete
  };
  /// Most ticks between two acknowledgements.
  static constexpr std::int64_t ack_interval = 16;

  /// `longest`: of each slot's message [bytes].
  LogWindow(std::int64_t num_ticks, const std::array<std::size_t, num_slots>& longest)
      : num_ticks_(num_ticks), ring_(longest) {}

  Verdict on_message(Slot slot, std::int64_t tick, std::span<const std::byte> bytes) {
    // Newer ones would push out what is not yet written; the plant's window keeps it from that.
    if (tick < 0 || tick >= num_ticks_ || tick > written_ + MessageRing::depth) {
      return Verdict::not_asked;
    }
    const bool late = tick + 1 < newest_;
    const Verdict verdict = ring_.put(tick, static_cast<int>(slot), bytes);
    if (verdict == Verdict::fresh) {
      if (slot != Slot::reference) newest_ = std::max(newest_, tick);
      if (late) filled_late_ = true;
    }
    // TRUTH is the last of what the plant repeats: one acknowledgement per repeated tick.
    if (slot == Slot::truth && (late || verdict != Verdict::fresh)) asked_again_ = true;
    return verdict;
  }

  /// The tick to be written next, when all its six messages are there.
  [[nodiscard]] std::optional<std::int64_t> complete_tick() const {
    if (!complete(written_ + 1)) return std::nullopt;
    return written_ + 1;
  }
  [[nodiscard]] std::span<const std::byte> bytes(std::int64_t tick, Slot slot) const {
    return ring_.bytes(tick, static_cast<int>(slot));
  }
  /// `complete_tick()` is in the log.
  void written() {
    if (!complete_tick()) throw std::logic_error("an incomplete tick was written");
    ++written_;
  }

  /// The acknowledgement to send now, if one is due. Call after writing the complete ticks.
  std::optional<Ack> take_ack() {
    const bool due = asked_again_ || (filled_late_ && written_ > acked_.tick) ||
                     newest_ - newest_acked_ >= ack_interval ||
                     (all_written() && written_ > acked_.tick);
    if (!due) return std::nullopt;
    Ack ack{written_, 0};
    // What belongs to the newest two ticks is probably on its way, unless the plant asks again.
    const std::int64_t last = asked_again_ ? newest_ : newest_ - 2;
    for (std::int64_t tick = written_ + 1; tick <= std::min(last, written_ + 64); ++tick) {
      if (!complete(tick)) ack.missing |= std::uint64_t{1} << (tick - written_ - 1);
    }
    acked_ = ack;
    newest_acked_ = newest_;
    asked_again_ = false;
    filled_late_ = false;
    return ack;
  }

  /// Whether the run's last tick is in the log.
  [[nodiscard]] bool all_written() const { return written_ == num_ticks_ - 1; }

 private:
  [[nodiscard]] bool complete(std::int64_t tick) const {
    int present = 0;
    while (present < num_slots && ring_.has(tick, present)) ++present;
    return present == num_slots;
  }

  std::int64_t num_ticks_;
  MessageRing ring_;
  std::int64_t written_ = -1;       ///< last tick in the log without a gap
  std::int64_t newest_ = -1;        ///< of which a message other than the reference was received
  Ack acked_;                       ///< the last one taken
  std::int64_t newest_acked_ = -1;  ///< newest_ at that time
  bool asked_again_ = false;  ///< the plant has repeated a message: it lacks an acknowledgement
  bool filled_late_ = false;  ///< a gap has been filled since
};

}  // namespace tachless::session

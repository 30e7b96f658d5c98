#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "logger/tick_ranges.h"
#include "messages/slot.h"
#include "session/message_ring.h"

namespace tachless::logger {

/// Counts what a realtime run's logger has received: which messages each tick has, which were
/// repeated, which were lost. Keeps no message. Preallocated.
class TickTally {
 public:
  using Slot = messages::Slot;
  using Verdict = session::Verdict;

  /// A message may be this many ticks late; a later one is too old.
  static constexpr std::int64_t window = 1024;
  using Missing = TickRanges<5>;

  explicit TickTally(std::int64_t num_ticks) : num_ticks_(num_ticks), entries_(window) {
    for (Missing& each : missing_) each.listed.reserve(Missing::most_listed);
  }

  /// Whether the message is to be recorded (`fresh`), or what else it is.
  Verdict on_message(Slot slot, std::int64_t tick, std::span<const std::byte> bytes) {
    if (tick < 0 || tick >= num_ticks_) return Verdict::not_asked;
    if (tick < settled_) return Verdict::too_old;
    settle_before(tick - window + 1);
    if (slot != Slot::reference) newest_ = std::max(newest_, tick);
    Entry& entry = entries_[static_cast<std::size_t>(tick % window)];
    if (entry.tick != tick) {
      entry = Entry();
      entry.tick = tick;
    }
    const std::uint64_t digest = session::digest_of(bytes);
    if (entry.has[index(slot)]) {
      return entry.digest[index(slot)] == digest ? Verdict::repeated : Verdict::conflicting;
    }
    entry.has[index(slot)] = true;
    entry.digest[index(slot)] = digest;
    return Verdict::fresh;
  }

  /// The run is over; `last` is its last tick.
  void finish(std::int64_t last) { settle_before(std::min(last + 1, num_ticks_)); }

  /// Newest tick of which a message other than the reference (it is a tick ahead) was received; -1
  /// before the first.
  [[nodiscard]] std::int64_t newest() const { return newest_; }
  /// Ticks with all their messages, and ticks that lack some; of those that are over.
  [[nodiscard]] std::int64_t complete() const { return complete_; }
  [[nodiscard]] std::int64_t incomplete() const { return settled_ - complete_; }

  /// Ticks that lack the message.
  [[nodiscard]] const Missing& missing(Slot slot) const { return missing_[index(slot)]; }

 private:
  struct Entry {
    std::int64_t tick = -1;
    std::array<bool, messages::num_slots> has{};
    std::array<std::uint64_t, messages::num_slots> digest{};
  };

  void settle_before(std::int64_t end) {
    for (; settled_ < end; ++settled_) {
      const Entry& entry = entries_[static_cast<std::size_t>(settled_ % window)];
      bool complete = true;
      for (const Slot slot : messages::all_slots) {
        if (entry.tick == settled_ && entry.has[index(slot)]) continue;
        complete = false;
        missing_[index(slot)].add(settled_);
      }
      if (complete) ++complete_;
    }
  }

  std::int64_t num_ticks_;
  std::vector<Entry> entries_;
  std::int64_t newest_ = -1;
  std::int64_t settled_ = 0;  ///< ticks before this are over
  std::int64_t complete_ = 0;
  std::array<Missing, messages::num_slots> missing_;
};

}  // namespace tachless::logger

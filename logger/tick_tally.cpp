#include "logger/tick_tally.h"

#include <algorithm>

namespace tachless::logger {

TickTally::TickTally(std::int64_t num_ticks, bool contact)
    : num_ticks_(num_ticks), contact_(contact), expected_(num_ticks) {
  for (Missing& each : missing_) each.listed.reserve(Missing::most_listed);
}

TickTally::Receipt TickTally::on_message(Slot slot, std::int64_t tick,
                                         std::span<const std::byte> bytes) {
  if (tick < 0 || tick >= num_ticks_) return Receipt::not_asked;
  if (tick < settled_) return Receipt::too_old;
  settle_before(tick - window + 1);
  if (slot != Slot::reference) newest_ = std::max(newest_, tick);
  Entry& entry = entries_[tick];
  if (entry.tick != tick) {
    entry = Entry();
    entry.tick = tick;
  }
  const std::uint64_t digest = session::digest_of(bytes);
  if (entry.has[index(slot)]) {
    return entry.digest[index(slot)] == digest ? Receipt::repeated : Receipt::conflicting;
  }
  entry.has[index(slot)] = true;
  entry.digest[index(slot)] = digest;
  return Receipt::fresh;
}

void TickTally::settle_before(std::int64_t end) {
  for (; settled_ < end; ++settled_) {
    const Entry& entry = entries_[settled_];
    bool complete = true;
    for (const Slot slot : messages::all_slots) {
      if (entry.tick == settled_ && entry.has[index(slot)]) continue;
      if (may_be_absent(slot) || (slot == Slot::contact && !contact_)) continue;
      if (settled_ >= stopped_from_ && !is_due_while_stopped(slot)) continue;
      complete = false;
      if (settled_ <= expected_) missing_[index(slot)].add(settled_);
    }
    if (complete) {
      ++complete_;
    } else if (settled_ <= expected_) {
      ++incomplete_;
    }
  }
}

}  // namespace tachless::logger

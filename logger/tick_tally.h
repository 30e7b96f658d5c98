#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "base/tick_ring.h"
#include "logger/tick_ranges.h"
#include "messages/slot.h"
#include "session/message_ring.h"

namespace tachless::logger {

/// Counts of a realtime run's received messages: which messages each tick has, which were repeated,
/// and which were lost. The class keeps no message. Its memory is preallocated.
class TickTally {
 public:
  using Slot = messages::Slot;
  using Receipt = session::Receipt;

  /// A message may be this many ticks late; a later one is too old.
  static constexpr std::int64_t window = 1024;
  using Missing = TickRanges<5>;

  /// @param contact whether each tick has a message in Slot::contact
  explicit TickTally(std::int64_t num_ticks, bool contact = false);

  /// Returns whether the message is to be recorded (`fresh`), or why not.
  Receipt on_message(Slot slot, std::int64_t tick, std::span<const std::byte> bytes);

  /// Notes that the robot is stopped from this tick on. Only messages that `is_due_while_stopped`
  /// names are then expected.
  void on_stop(std::int64_t tick) { stopped_from_ = std::min(stopped_from_, tick); }
  /// Notes that the run is being stopped, from `last` on: no tick after it counts as incomplete.
  void stop_after(std::int64_t last) { expected_ = std::min(expected_, last); }

  /// Notes that the run is over; `last` is its last tick.
  void finish(std::int64_t last) { settle_before(std::min(last + 1, num_ticks_)); }

  /// Returns the newest tick of which a message was received; -1 before the first. The reference
  /// does not count, because it is a tick ahead.
  [[nodiscard]] std::int64_t newest() const { return newest_; }
  /// Return the number of ticks that are over and have all their messages, or lack at least one.
  [[nodiscard]] std::int64_t num_complete() const { return complete_; }
  [[nodiscard]] std::int64_t num_incomplete() const { return incomplete_; }

  /// Returns the ticks that lack the message, up to the tick after which the run was stopped.
  [[nodiscard]] const Missing& missing(Slot slot) const { return missing_[index(slot)]; }

 private:
  struct Entry {
    std::int64_t tick = -1;
    std::array<bool, messages::num_slots> has{};
    std::array<std::uint64_t, messages::num_slots> digest{};
  };

  void settle_before(std::int64_t end);

  std::int64_t num_ticks_;
  bool contact_;
  base::TickRing<Entry> entries_{window};
  std::int64_t newest_ = -1;
  std::int64_t settled_ = 0;  ///< ticks before this are over
  std::int64_t complete_ = 0;
  std::int64_t stopped_from_ = std::numeric_limits<std::int64_t>::max();
  std::int64_t incomplete_ = 0;
  std::int64_t expected_;  ///< messages are expected up to this tick
  std::array<Missing, messages::num_slots> missing_;
};

}  // namespace tachless::logger

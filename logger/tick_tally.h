#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "protocol/lockstep/log_window.h"

namespace tachless::logger {

/// Counts what a realtime run's logger has received: which messages each tick has, which were
/// repeated, which were lost. Keeps no message. Preallocated.
class TickTally {
 public:
  using Slot = loop::Slot;

  /// A message may be this many ticks late; a later one is too old.
  static constexpr std::int64_t window = 1024;
  static constexpr std::size_t max_listed = 5;

  explicit TickTally(std::int64_t num_ticks);

  /// Whether the message is to be recorded (`fresh`), or what else it is.
  protocol::lockstep::Verdict on_message(Slot slot, std::int64_t tick,
                                         std::span<const std::byte> bytes);

  /// The run is over; `last` is its last tick.
  void finish(std::int64_t last);

  /// Newest tick of which a message other than the reference (it is a tick ahead) was received; -1
  /// before the first.
  [[nodiscard]] std::int64_t newest() const { return newest_; }
  /// Ticks with all their messages, and ticks that lack some; of those that are over.
  [[nodiscard]] std::int64_t complete() const { return complete_; }
  [[nodiscard]] std::int64_t incomplete() const { return incomplete_; }

  /// Consecutive ticks that lack a message.
  struct Range {
    std::int64_t first = 0;
    std::int64_t last = 0;
  };
  struct Missing {
    std::int64_t count = 0;
    std::vector<Range> listed;  ///< the first `max_listed` ranges
    std::int64_t ranges = 0;
  };
  [[nodiscard]] const Missing& missing(Slot slot) const {
    return missing_[static_cast<std::size_t>(slot)];
  }

 private:
  struct Entry {
    std::int64_t tick = -1;
    std::array<bool, loop::num_slots> has{};
    std::array<std::uint64_t, loop::num_slots> digest{};
  };

  void settle_before(std::int64_t tick);
  void settle(std::int64_t tick);

  std::int64_t num_ticks_;
  std::vector<Entry> entries_;
  std::int64_t newest_ = -1;
  std::int64_t settled_ = 0;  ///< ticks before this are over
  std::int64_t complete_ = 0;
  std::int64_t incomplete_ = 0;
  std::array<Missing, loop::num_slots> missing_;
};

/// "12, 40-55 and 3 more": ticks that lack a message.
std::string text_of(const TickTally::Missing& missing);

}  // namespace tachless::logger

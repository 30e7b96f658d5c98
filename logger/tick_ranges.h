#pragma once

#include <fmt/core.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "messages/slot.h"

namespace tachless::logger {

/// Returns true if a tick of a protective stop has this message. No process answers the plant then,
/// so the other messages are no gaps.
constexpr bool is_due_while_stopped(messages::Slot slot) {
  return slot == messages::Slot::tick || slot == messages::Slot::measurement ||
         slot == messages::Slot::truth || slot == messages::Slot::contact;
}

/// Returns true for messages that no scenario promises: a real arm may tell no torques.
constexpr bool may_be_absent(messages::Slot slot) { return slot == messages::Slot::arm_torque; }

/// Ticks in a row: first to last, both included.
struct TickRange {
  std::int64_t first = 0;
  std::int64_t last = 0;
};

/// A set of ticks as ranges: all are counted, the first `max_listed` ranges are listed.
template <std::size_t max_listed>
struct TickRanges {
  static constexpr std::size_t most_listed = max_listed;

  std::uint64_t count = 0;  ///< ticks
  std::uint64_t ranges = 0;
  std::vector<TickRange> listed;

  /// Adds ticks, which have to be later than all before.
  void add(const TickRange& added) {
    count += static_cast<std::uint64_t>(added.last - added.first + 1);
    const bool joins = ranges != 0 && added.first == last_ + 1;
    last_ = added.last;
    if (!joins) {
      ++ranges;
      if (listed.size() < max_listed) listed.push_back(added);
    } else if (!cut()) {
      listed.back().last = added.last;
    }
  }
  void add(std::int64_t tick) { add({tick, tick}); }

  /// Returns true if some ranges are counted and not listed.
  [[nodiscard]] bool cut() const { return ranges > listed.size(); }

  /// Returns e.g. "12, 40-55 and 3 more".
  [[nodiscard]] std::string text() const {
    std::string text;
    for (const auto& [first, last] : listed) {
      text += fmt::format("{}{}", text.empty() ? "" : ", ", first);
      if (last > first) text += fmt::format("-{}", last);
    }
    if (cut()) text += fmt::format(" and {} more", ranges - listed.size());
    return text;
  }

 private:
  std::int64_t last_ = 0;
};

}  // namespace tachless::logger

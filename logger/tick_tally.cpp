#include "logger/tick_tally.h"

#include <fmt/core.h>

#include <algorithm>

namespace tachless::logger {
namespace {

using loop::num_slots;
using protocol::lockstep::Verdict;

/// FNV-1a: tells a repeat from a conflicting message.
std::uint64_t digest_of(std::span<const std::byte> bytes) {
  std::uint64_t digest = 0xcbf29ce484222325;
  for (const std::byte byte : bytes) {
    digest = (digest ^ std::to_integer<std::uint64_t>(byte)) * 0x100000001b3;
  }
  return digest;
}

}  // namespace

TickTally::TickTally(std::int64_t num_ticks) : num_ticks_(num_ticks), entries_(window) {
  for (Missing& each : missing_) each.listed.reserve(max_listed);
}

Verdict TickTally::on_message(Slot slot, std::int64_t tick, std::span<const std::byte> bytes) {
  if (tick < 0 || tick >= num_ticks_) return Verdict::not_asked;
  if (tick < settled_) return Verdict::too_old;
  settle_before(tick - window + 1);
  if (slot != Slot::reference) newest_ = std::max(newest_, tick);
  Entry& entry = entries_[static_cast<std::size_t>(tick % window)];
  if (entry.tick != tick) {
    entry = Entry();
    entry.tick = tick;
  }
  const auto index = static_cast<std::size_t>(slot);
  const std::uint64_t digest = digest_of(bytes);
  if (entry.has[index]) {
    return entry.digest[index] == digest ? Verdict::repeated : Verdict::conflicting;
  }
  entry.has[index] = true;
  entry.digest[index] = digest;
  return Verdict::fresh;
}

void TickTally::finish(std::int64_t last) { settle_before(std::min(last + 1, num_ticks_)); }

void TickTally::settle_before(std::int64_t tick) {
  for (; settled_ < tick; ++settled_) settle(settled_);
}

void TickTally::settle(std::int64_t tick) {
  const Entry& entry = entries_[static_cast<std::size_t>(tick % window)];
  bool complete = true;
  for (std::size_t i = 0; i < num_slots; ++i) {
    if (entry.tick == tick && entry.has[i]) continue;
    complete = false;
    Missing& missing = missing_[i];
    ++missing.count;
    if (!missing.listed.empty() && missing.listed.back().last == tick - 1) {
      missing.listed.back().last = tick;
    } else {
      ++missing.ranges;
      if (missing.listed.size() < max_listed) missing.listed.push_back({tick, tick});
    }
  }
  ++(complete ? complete_ : incomplete_);
}

std::string text_of(const TickTally::Missing& missing) {
  std::string text;
  for (const TickTally::Range& range : missing.listed) {
    if (!text.empty()) text += ", ";
    text += range.last > range.first ? fmt::format("{}-{}", range.first, range.last)
                                     : fmt::format("{}", range.first);
  }
  const auto more = missing.ranges - static_cast<std::int64_t>(missing.listed.size());
  if (more > 0) text += fmt::format(" and {} more", more);
  return text;
}

}  // namespace tachless::logger

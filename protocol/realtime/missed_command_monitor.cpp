#include "protocol/realtime/missed_command_monitor.h"

#include <algorithm>
#include <array>

namespace tachless::protocol::realtime {

using lockstep::Verdict;

MissedCommandMonitor::MissedCommandMonitor(int max_missed, std::size_t longest_command)
    : max_missed_(max_missed), commands_(std::array{longest_command}) {}

void MissedCommandMonitor::begin(std::int64_t tick) {
  tick_ = tick;
  commanded_ = false;
}

Verdict MissedCommandMonitor::on_command(std::int64_t tick, std::span<const std::byte> bytes,
                                         std::string_view sender) {
  if (tick < 0 || tick > tick_) return Verdict::not_asked;
  const Verdict verdict = commands_.put(tick, 0, bytes, sender);
  if (verdict != Verdict::fresh) return verdict;
  if (tick < tick_) return Verdict::too_old;
  commanded_ = true;
  return Verdict::fresh;
}

std::string_view MissedCommandMonitor::sender_of(std::int64_t tick) const {
  return commands_.sender(tick, 0);
}

void MissedCommandMonitor::end() {
  in_a_row_ = commanded_ ? 0 : in_a_row_ + 1;
  missed_ += commanded_ ? 0 : 1;
  longest_ = std::max(longest_, in_a_row_);
}

}  // namespace tachless::protocol::realtime

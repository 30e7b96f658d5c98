#include "protocol/realtime/command_watch.h"

#include <algorithm>
#include <array>

namespace tachless::protocol::realtime {

CommandWatch::CommandWatch(int max_missed, std::size_t longest_command)
    : max_missed_(max_missed), commands_(std::array{longest_command}) {}

void CommandWatch::begin(std::int64_t tick) {
  tick_ = tick;
  commanded_ = false;
}

CommandWatch::Verdict CommandWatch::on_command(std::int64_t tick, std::span<const std::byte> bytes,
                                               std::string_view sender) {
  if (tick < 0 || tick > tick_) return Verdict::not_asked;
  switch (commands_.put(tick, 0, bytes, sender)) {
    case lockstep::Verdict::conflicting:
      return Verdict::conflicting;
    case lockstep::Verdict::repeated:
      return Verdict::repeated;
    default:
      break;
  }
  if (tick < tick_) return Verdict::late;
  commanded_ = true;
  return Verdict::fresh;
}

std::string_view CommandWatch::commander(std::int64_t tick) const {
  return commands_.sender(tick, 0);
}

void CommandWatch::end() {
  in_a_row_ = commanded_ ? 0 : in_a_row_ + 1;
  missed_ += commanded_ ? 0 : 1;
  longest_ = std::max(longest_, in_a_row_);
}

}  // namespace tachless::protocol::realtime

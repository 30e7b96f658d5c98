#include "protocol/realtime/reference_responder.h"

#include <algorithm>
#include <array>

namespace tachless::protocol::realtime {

using lockstep::Verdict;

ReferenceResponder::ReferenceResponder(std::int64_t num_ticks, std::size_t longest_tick)
    : num_ticks_(num_ticks), ticks_(std::array{longest_tick}) {}

ReferenceResponder::Answer ReferenceResponder::on_tick(std::int64_t tick,
                                                       std::span<const std::byte> bytes,
                                                       std::string_view sender) {
  Answer answer;
  if (tick < 0 || tick >= num_ticks_) {
    answer.verdict = Verdict::not_asked;
    return answer;
  }
  answer.verdict = ticks_.put(tick, 0, bytes, sender);
  if (answer.verdict != Verdict::fresh) return answer;
  answer.first = std::max(newest_ + 1, tick);
  answer.last = std::min(tick + 1, num_ticks_ - 1);
  newest_ = std::max(newest_, answer.last);
  return answer;
}

std::string_view ReferenceResponder::sender_of(std::int64_t tick) const {
  return ticks_.sender(tick, 0);
}

}  // namespace tachless::protocol::realtime

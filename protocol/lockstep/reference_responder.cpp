#include "protocol/lockstep/reference_responder.h"

#include <algorithm>
#include <array>
#include <stdexcept>

namespace tachless::protocol::lockstep {
namespace {
enum Kind : int { question, answer };
}

ReferenceResponder::ReferenceResponder(std::int64_t num_ticks, std::size_t longest_tick,
                                       std::size_t longest_reference)
    : num_ticks_(num_ticks), ring_(std::array{longest_tick, longest_reference}) {}

ReferenceResponder::Answer ReferenceResponder::on_tick(std::int64_t tick,
                                                       std::span<const std::byte> bytes,
                                                       std::string_view sender) {
  // The plant cannot have begun k without command k - 1, hence not without reference k - 1.
  if (tick < 0 || tick >= num_ticks_ || tick > newest_ + 1) return {Verdict::not_asked, {}, {}};
  Answer result;
  result.verdict = ring_.put(tick, question, bytes, sender);
  if (result.verdict != Verdict::fresh && result.verdict != Verdict::repeated) return result;
  const std::int64_t last = std::min(tick + 1, num_ticks_ - 1);
  result.compute = {newest_ + 1, last};
  if (result.verdict == Verdict::repeated || tick + 1 <= newest_) {
    result.repeat = {tick, std::min(last, newest_)};
  }
  return result;
}

void ReferenceResponder::computed(std::int64_t tick, std::span<const std::byte> bytes) {
  if (tick != newest_ + 1) throw std::logic_error("a reference was computed out of turn");
  if (ring_.put(tick, answer, bytes) != Verdict::fresh) {
    throw std::logic_error("a reference was computed twice");
  }
  newest_ = tick;
}

std::span<const std::byte> ReferenceResponder::kept(std::int64_t tick) const {
  return ring_.bytes(tick, answer);
}

std::string_view ReferenceResponder::sender_of(std::int64_t tick) const {
  return ring_.sender(tick, question);
}

}  // namespace tachless::protocol::lockstep

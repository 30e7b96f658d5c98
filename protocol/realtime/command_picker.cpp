#include "protocol/realtime/command_picker.h"

#include <algorithm>
#include <array>
#include <stdexcept>

namespace tachless::protocol::realtime {
namespace {
// The first two in the order of Input.
enum Kind : int { measurement_kind, reference_kind };
}  // namespace

using lockstep::MessageRing;
using lockstep::Verdict;

CommandPicker::CommandPicker(std::int64_t num_ticks, std::size_t longest_measurement,
                             std::size_t longest_reference)
    : num_ticks_(num_ticks), ring_(std::array{longest_measurement, longest_reference}) {}

Verdict CommandPicker::on_measurement(std::int64_t tick, std::span<const std::byte> bytes,
                                      std::string_view sender) {
  if (tick < 0 || tick >= num_ticks_) return Verdict::not_asked;
  const Verdict verdict = ring_.put(tick, measurement_kind, bytes, sender);
  if (verdict != Verdict::fresh) return verdict;
  newest_ = std::max(newest_, tick);
  return tick > last_ ? Verdict::fresh : Verdict::too_old;
}

Verdict CommandPicker::on_reference(std::int64_t tick, std::span<const std::byte> bytes,
                                    std::string_view sender) {
  if (tick < 0 || tick >= num_ticks_) return Verdict::not_asked;
  return ring_.put(tick, reference_kind, bytes, sender);
}

std::optional<std::int64_t> CommandPicker::due() const {
  // A reference that is one tick ahead may have taken the place of a tick `depth` before it.
  const std::int64_t oldest = std::max(last_ + 1, newest_ - MessageRing::depth + 2);
  for (std::int64_t tick = newest_; tick >= oldest; --tick) {
    if (ring_.has(tick, measurement_kind) && ring_.has(tick, reference_kind)) return tick;
  }
  return std::nullopt;
}

void CommandPicker::acted(std::int64_t tick) {
  if (tick <= last_) throw std::logic_error("a tick was acted on out of turn");
  last_ = tick;
}

std::span<const std::byte> CommandPicker::measurement(std::int64_t tick) const {
  return ring_.bytes(tick, measurement_kind);
}
std::span<const std::byte> CommandPicker::reference(std::int64_t tick) const {
  return ring_.bytes(tick, reference_kind);
}
std::string_view CommandPicker::sender_of(Input input, std::int64_t tick) const {
  return ring_.sender(tick, static_cast<int>(input));
}

}  // namespace tachless::protocol::realtime

#include "protocol/lockstep/command_answerer.h"

#include <array>
#include <stdexcept>

namespace tachless::protocol::lockstep {
namespace {
enum Kind : int { measurement_kind, reference_kind, command_kind, state_kind };
}

CommandAnswerer::CommandAnswerer(std::int64_t num_ticks, const Lengths& lengths)
    : num_ticks_(num_ticks),
      ring_(std::array{lengths.measurement, lengths.reference, lengths.command, lengths.state}) {}

void CommandAnswerer::resume(std::int64_t next) {
  next_ = next;
  asked_before_ = next + reach;
}

bool CommandAnswerer::ready() const {
  return ring_.has(next_, measurement_kind) && ring_.has(next_, reference_kind);
}

CommandAnswerer::Answer CommandAnswerer::on_measurement(std::int64_t tick,
                                                        std::span<const std::byte> bytes,
                                                        std::string_view sender) {
  if (tick < 0 || tick >= num_ticks_ || (tick > next_ && tick >= asked_before_)) {
    return {Verdict::not_asked, Action::nothing};
  }
  const Verdict verdict = ring_.put(tick, measurement_kind, bytes, sender);
  if (verdict == Verdict::fresh) return {verdict, compute_if_ready()};
  // A predecessor's answers are not kept here; whoever asks for them is answered by the log.
  if (verdict == Verdict::repeated && ring_.has(tick, command_kind)) {
    return {verdict, Action::repeat};
  }
  return {verdict, Action::nothing};
}

CommandAnswerer::Answer CommandAnswerer::on_reference(std::int64_t tick,
                                                      std::span<const std::byte> bytes,
                                                      std::string_view sender) {
  // The plant is at tick next() at most, and the reference one ahead of it.
  if (tick < 0 || tick >= num_ticks_ || (tick > next_ + 1 && tick >= asked_before_)) {
    return {Verdict::not_asked, Action::nothing};
  }
  const Verdict verdict = ring_.put(tick, reference_kind, bytes, sender);
  return {verdict, verdict == Verdict::fresh ? compute_if_ready() : Action::nothing};
}

void CommandAnswerer::computed(std::span<const std::byte> command,
                               std::span<const std::byte> state) {
  if (!ready()) {
    throw std::logic_error("a command was computed without its inputs");
  }
  if (ring_.put(next_, command_kind, command) != Verdict::fresh ||
      ring_.put(next_, state_kind, state) != Verdict::fresh) {
    throw std::logic_error("a command was computed twice");
  }
  ++next_;
}

std::span<const std::byte> CommandAnswerer::measurement(std::int64_t tick) const {
  return ring_.bytes(tick, measurement_kind);
}
std::span<const std::byte> CommandAnswerer::reference(std::int64_t tick) const {
  return ring_.bytes(tick, reference_kind);
}
std::span<const std::byte> CommandAnswerer::command(std::int64_t tick) const {
  return ring_.bytes(tick, command_kind);
}
std::span<const std::byte> CommandAnswerer::state(std::int64_t tick) const {
  return ring_.bytes(tick, state_kind);
}
std::string_view CommandAnswerer::asker(std::int64_t tick) const {
  return ring_.sender(tick, measurement_kind);
}
std::string_view CommandAnswerer::referrer(std::int64_t tick) const {
  return ring_.sender(tick, reference_kind);
}

}  // namespace tachless::protocol::lockstep

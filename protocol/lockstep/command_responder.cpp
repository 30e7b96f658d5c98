#include "protocol/lockstep/command_responder.h"

#include <array>
#include <stdexcept>

namespace tachless::protocol::lockstep {
namespace {
// The first two in the order of Input.
enum Kind : int { measurement_kind, reference_kind, command_kind, state_kind };
}  // namespace

CommandResponder::CommandResponder(std::int64_t num_ticks, const Lengths& lengths)
    : num_ticks_(num_ticks),
      ring_(std::array{lengths.measurement, lengths.reference, lengths.command, lengths.state}) {}

void CommandResponder::resume(std::int64_t next) {
  next_ = next;
  asked_before_ = next + reach;
}

bool CommandResponder::ready() const {
  return ring_.has(next_, measurement_kind) && ring_.has(next_, reference_kind);
}

CommandResponder::Answer CommandResponder::on_measurement(std::int64_t tick,
                                                          std::span<const std::byte> bytes,
                                                          std::string_view sender) {
  if (tick < 0 || tick >= num_ticks_ || (tick > next_ && tick >= asked_before_)) {
    return {Verdict::not_asked, Action::nothing};
  }
  const Verdict verdict = ring_.put(tick, measurement_kind, bytes, sender);
  if (verdict == Verdict::fresh) return {verdict, compute_if_ready()};
  // The predecessor's replies are not kept here: they are in the log.
  if (verdict == Verdict::repeated && ring_.has(tick, command_kind)) {
    return {verdict, Action::repeat};
  }
  return {verdict, Action::nothing};
}

CommandResponder::Answer CommandResponder::on_reference(std::int64_t tick,
                                                        std::span<const std::byte> bytes,
                                                        std::string_view sender) {
  // The plant is at tick next() at most, and the reference one ahead of it.
  if (tick < 0 || tick >= num_ticks_ || (tick > next_ + 1 && tick >= asked_before_)) {
    return {Verdict::not_asked, Action::nothing};
  }
  const Verdict verdict = ring_.put(tick, reference_kind, bytes, sender);
  return {verdict, verdict == Verdict::fresh ? compute_if_ready() : Action::nothing};
}

void CommandResponder::computed(std::span<const std::byte> command,
                                std::span<const std::byte> state) {
  if (!ready()) throw std::logic_error("a command was computed without its inputs");
  if (ring_.put(next_, command_kind, command) != Verdict::fresh ||
      ring_.put(next_, state_kind, state) != Verdict::fresh) {
    throw std::logic_error("a command was computed twice");
  }
  ++next_;
}

std::span<const std::byte> CommandResponder::command(std::int64_t tick) const {
  return ring_.bytes(tick, command_kind);
}
std::span<const std::byte> CommandResponder::state(std::int64_t tick) const {
  return ring_.bytes(tick, state_kind);
}
std::string_view CommandResponder::sender_of(Input input, std::int64_t tick) const {
  return ring_.sender(tick, static_cast<int>(input));
}

}  // namespace tachless::protocol::lockstep

#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>

#include "protocol/lockstep/message_ring.h"

/// The reference's answers, in both modes, and the controller's in lockstep: each request is
/// answered once, in order, and in lockstep the reply is kept for a request that comes again.
namespace tachless::protocol::lockstep {

/// The reference's side: TICK(k) requests every reference up to k + 1 that is not yet published, so
/// that no process waits for the reference, and TICK(k + 1) makes up for a lost TICK(k). The reply
/// to a repeated TICK is the same bytes again. In realtime what has gone by is left out: references
/// before k are not published later, nor any again.
class ReferenceResponder {
 public:
  /// An empty range has last < first.
  struct Range {
    std::int64_t first = 0;
    std::int64_t last = -1;
  };
  struct Answer {
    Verdict verdict = Verdict::fresh;
    Range compute;  ///< compute these in order, publish each and tell `computed`
    Range repeat;   ///< publish `kept` of these again
  };

  ReferenceResponder(std::int64_t num_ticks, std::size_t longest_reference, bool realtime = false)
      : num_ticks_(num_ticks),
        realtime_(realtime),
        ring_(std::array{MessageRing::digest_only, longest_reference}) {}

  Answer on_tick(std::int64_t tick, std::span<const std::byte> bytes) {
    // In lockstep the plant cannot have begun k without command k - 1, hence not without reference
    // k - 1.
    if (tick < 0 || tick >= num_ticks_ || (!realtime_ && tick > newest_ + 1)) {
      return {Verdict::not_asked, {}, {}};
    }
    Answer result{ring_.put(tick, tick_kind, bytes), {}, {}};
    if (result.verdict != Verdict::fresh && result.verdict != Verdict::repeated) return result;
    const std::int64_t last = std::min(tick + 1, num_ticks_ - 1);
    result.compute = {std::max(newest_ + 1, tick), last};
    if (!realtime_ && (result.verdict == Verdict::repeated || tick + 1 <= newest_)) {
      result.repeat = {tick, std::min(last, newest_)};
    }
    return result;
  }

  /// @throw std::logic_error unless `tick` is the one after the last, or in realtime a later one.
  void computed(std::int64_t tick, std::span<const std::byte> bytes) {
    if (tick <= newest_ || (!realtime_ && tick > newest_ + 1)) {
      throw std::logic_error("a reference was computed out of turn");
    }
    if (!realtime_) ring_.put(tick, reference_kind, bytes);
    newest_ = tick;
  }

  /// In lockstep.
  [[nodiscard]] std::span<const std::byte> kept(std::int64_t tick) const {
    return ring_.bytes(tick, reference_kind);
  }
  /// Newest tick whose reference is computed; -1 before the first.
  [[nodiscard]] std::int64_t newest() const { return newest_; }

 private:
  enum Kind : int { tick_kind, reference_kind };

  std::int64_t num_ticks_;
  bool realtime_;
  std::int64_t newest_ = -1;
  MessageRing ring_;
};

/// The controller's inputs.
enum LawInput : int { measurement_input, reference_input, num_law_inputs };

/// The controller's side: a measurement asks for the command and controller state of its tick;
/// they are computed once, strictly in order, as soon as the tick's reference is there too. A
/// measurement that comes again is answered with what is kept.
class CommandResponder {
 public:
  enum class Action { nothing, compute, repeat };
  struct Answer {
    Verdict verdict = Verdict::fresh;
    /// compute: the law's step of tick `next()`, publish both messages and tell `computed`.
    /// repeat: publish the kept messages of the measurement's tick again.
    Action action = Action::nothing;
  };

  CommandResponder(std::int64_t num_ticks, std::size_t longest_command, std::size_t longest_state)
      : num_ticks_(num_ticks),
        ring_(std::array{MessageRing::digest_only, MessageRing::digest_only, longest_command,
                         longest_state}) {}

  Answer on_input(LawInput input, std::int64_t tick, std::span<const std::byte> bytes) {
    const bool measured = input == measurement_input;
    // The plant is at tick next() at most, and the reference one ahead of it.
    const std::int64_t newest = measured ? next_ : next_ + 1;
    if (tick < 0 || tick >= num_ticks_ || tick > newest) {
      return {Verdict::not_asked, Action::nothing};
    }
    const Verdict verdict = ring_.put(tick, input, bytes);
    if (verdict == Verdict::fresh && ready()) return {verdict, Action::compute};
    const bool repeat = measured && verdict == Verdict::repeated && ring_.has(tick, command_kind);
    return {verdict, repeat ? Action::repeat : Action::nothing};
  }

  /// Tick whose command is the next to be computed.
  [[nodiscard]] std::int64_t next() const { return next_; }
  /// Whether the run's last tick is computed.
  [[nodiscard]] bool all_computed() const { return next_ == num_ticks_; }
  /// Whether both its inputs are there.
  [[nodiscard]] bool ready() const {
    return ring_.has(next_, measurement_input) && ring_.has(next_, reference_input);
  }

  /// The replies of tick `next()`.
  void computed(std::span<const std::byte> command, std::span<const std::byte> state) {
    if (!ready()) throw std::logic_error("a command was computed without its inputs");
    ring_.put(next_, command_kind, command);
    ring_.put(next_, state_kind, state);
    ++next_;
  }

  [[nodiscard]] std::span<const std::byte> command(std::int64_t tick) const {
    return ring_.bytes(tick, command_kind);
  }
  [[nodiscard]] std::span<const std::byte> state(std::int64_t tick) const {
    return ring_.bytes(tick, state_kind);
  }

 private:
  enum Kind : int { command_kind = num_law_inputs, state_kind };

  std::int64_t num_ticks_;
  std::int64_t next_ = 0;
  MessageRing ring_;
};

}  // namespace tachless::protocol::lockstep

#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "protocol/lockstep/message_ring.h"
#include "protocol/lockstep/verdict.h"

namespace tachless::protocol::lockstep {

/// The controller's side: a measurement asks for the command and controller state of its tick;
/// they are computed once, strictly in order, as soon as the tick's reference is there too. A
/// measurement that comes again is answered with what is kept.
class CommandResponder {
 public:
  enum class Input { measurement, reference };
  enum class Action { nothing, compute, repeat };
  struct Answer {
    Verdict verdict = Verdict::fresh;
    /// compute: the law's step of tick `next()`, publish both messages and tell `computed`.
    /// repeat: publish the kept messages of the measurement's tick again.
    Action action = Action::nothing;
  };
  struct Lengths {
    std::size_t measurement = 0, reference = 0, command = 0, state = 0;  ///< longest [bytes]
  };

  CommandResponder(std::int64_t num_ticks, const Lengths& lengths);

  /// Takes over from a controller that has commanded the ticks before `next`: the next command is
  /// that of `next`. Called before any message is handled. Requests that the predecessor received
  /// may be repeated in any order, so those of up to `reach` ticks from `next` on are kept.
  void resume(std::int64_t next);
  static constexpr std::int64_t reach = MessageRing::depth;

  Answer on_measurement(std::int64_t tick, std::span<const std::byte> bytes,
                        std::string_view sender);
  Answer on_reference(std::int64_t tick, std::span<const std::byte> bytes, std::string_view sender);

  /// Tick whose command is the next to be computed.
  [[nodiscard]] std::int64_t next() const { return next_; }
  /// Whether the run's last tick is computed.
  [[nodiscard]] bool all_computed() const { return next_ == num_ticks_; }
  /// Whether both its inputs are there. While a new controller catches up, this may hold again
  /// right after `computed`.
  [[nodiscard]] bool ready() const;

  /// The replies of tick `next()`.
  void computed(std::span<const std::byte> command, std::span<const std::byte> state);

  [[nodiscard]] std::span<const std::byte> command(std::int64_t tick) const;
  [[nodiscard]] std::span<const std::byte> state(std::int64_t tick) const;
  /// Who sent the input that is kept for `tick`.
  [[nodiscard]] std::string_view sender_of(Input input, std::int64_t tick) const;

 private:
  [[nodiscard]] Action compute_if_ready() const {
    return ready() ? Action::compute : Action::nothing;
  }

  std::int64_t num_ticks_;
  std::int64_t next_ = 0;
  std::int64_t asked_before_ = 0;  ///< ticks before this may have been requested of a predecessor
  MessageRing ring_;
};

}  // namespace tachless::protocol::lockstep

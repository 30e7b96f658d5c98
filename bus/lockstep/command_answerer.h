#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "bus/lockstep/message_ring.h"
#include "bus/lockstep/verdict.h"

namespace bus::lockstep {

/// The controller's side: a measurement asks for the command and controller state of its tick;
/// they are computed once, strictly in order, as soon as the tick's reference is there too. A
/// measurement that comes again is answered with what is kept.
class CommandAnswerer {
 public:
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

  CommandAnswerer(std::int64_t num_ticks, const Lengths& lengths);

  Answer on_measurement(std::int64_t tick, std::span<const std::byte> bytes,
                        std::string_view sender);
  Answer on_reference(std::int64_t tick, std::span<const std::byte> bytes, std::string_view sender);

  /// Tick whose command is the next to be computed.
  [[nodiscard]] std::int64_t next() const { return next_; }

  /// The answers of tick `next()`.
  void computed(std::span<const std::byte> command, std::span<const std::byte> state);

  [[nodiscard]] std::span<const std::byte> measurement(std::int64_t tick) const;
  [[nodiscard]] std::span<const std::byte> reference(std::int64_t tick) const;
  [[nodiscard]] std::span<const std::byte> command(std::int64_t tick) const;
  [[nodiscard]] std::span<const std::byte> state(std::int64_t tick) const;
  /// Who sent the measurement (reference) that is kept.
  [[nodiscard]] std::string_view asker(std::int64_t tick) const;
  [[nodiscard]] std::string_view referrer(std::int64_t tick) const;

 private:
  [[nodiscard]] Action compute_if_ready() const;

  std::int64_t num_ticks_;
  std::int64_t next_ = 0;
  MessageRing ring_;
};

}  // namespace bus::lockstep

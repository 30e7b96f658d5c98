#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "loop/slot.h"
#include "protocol/lockstep/message_ring.h"
#include "protocol/lockstep/verdict.h"

namespace tachless::protocol::lockstep {

using loop::num_slots;
using loop::Slot;

/// The logger's side: collects the six messages of each tick in any order of arrival, gives
/// complete ticks in order, and decides when to acknowledge and what to report as missing. Writes
/// nothing.
class LogWindow {
 public:
  struct Ack {
    std::int64_t tick = -2;     ///< last without a gap; -1: RUN_INFO only; -2: not even that
    std::uint64_t missing = 0;  ///< bit i: tick + 1 + i has begun but is incomplete
  };
  /// Most ticks between two acknowledgements.
  static constexpr std::int64_t ack_interval = 16;

  /// `longest`: of each slot's message [bytes].
  LogWindow(std::int64_t num_ticks, const std::array<std::size_t, num_slots>& longest);

  /// RUN_INFO of this run was received; `same`: it equals the one before, if there was one.
  Verdict on_run_info(bool same);

  Verdict on_message(Slot slot, std::int64_t tick, std::span<const std::byte> bytes,
                     std::string_view sender);

  /// The tick to be written next, when RUN_INFO and all its six messages are there.
  [[nodiscard]] std::optional<std::int64_t> complete_tick() const;
  [[nodiscard]] std::span<const std::byte> bytes(std::int64_t tick, Slot slot) const;
  [[nodiscard]] std::string_view sender(std::int64_t tick, Slot slot) const;
  /// `complete_tick()` is in the log.
  void written();

  /// The acknowledgement to send now, if one is due. Call after writing the complete ticks.
  std::optional<Ack> take_ack();

  /// Last tick in the log without a gap.
  [[nodiscard]] std::int64_t last_written() const { return written_; }
  /// Whether the run's last tick is.
  [[nodiscard]] bool all_written() const { return written_ == num_ticks_ - 1; }
  /// Newest tick of which a message other than the reference was received.
  [[nodiscard]] std::int64_t newest() const { return newest_; }

 private:
  [[nodiscard]] bool complete(std::int64_t tick) const;

  std::int64_t num_ticks_;
  MessageRing ring_;
  bool introduced_ = false;
  std::int64_t written_ = -1;
  std::int64_t newest_ = -1;
  Ack acked_;                       ///< the last one taken
  std::int64_t newest_acked_ = -1;  ///< newest_ at that time
  bool asked_again_ = false;  ///< the plant has repeated a message: it lacks an acknowledgement
  bool filled_late_ = false;  ///< a gap has been filled since
};

}  // namespace tachless::protocol::lockstep

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "messages/slot.h"
#include "session/message_ring.h"

namespace tachless::session {

using messages::num_slots;
using messages::Slot;

/// The logger's side of the tick protocol. It collects the messages of each tick in any order
/// of arrival and gives complete ticks in order. It decides when to acknowledge, and which ticks to
/// report as missing. It writes nothing.
class LogWindow {
 public:
  struct Ack {
    std::int64_t tick = -1;     ///< last tick without a gap; -1: none
    std::uint64_t missing = 0;  ///< bit i: tick + 1 + i has begun but is incomplete
  };
  /// Most ticks between two acknowledgements.
  static constexpr std::int64_t ack_interval = 16;

  /// @param longest length of the longest message of each slot [bytes]; 0: the run has no such
  /// message
  LogWindow(std::int64_t num_ticks, const std::array<std::size_t, num_slots>& longest)
      : num_ticks_(num_ticks), longest_(longest), ring_(longest) {}

  Receipt on_message(Slot slot, std::int64_t tick, std::span<const std::byte> bytes);

  /// Returns the tick to be written next, if all its messages have arrived.
  [[nodiscard]] std::optional<std::int64_t> complete_tick() const;
  [[nodiscard]] std::span<const std::byte> bytes(std::int64_t tick, Slot slot) const;
  /// Notes that `complete_tick()` is in the log.
  void on_written();

  /// Returns the acknowledgement to send now, if one is due. Call it after writing complete ticks.
  std::optional<Ack> take_ack();

  /// Returns whether the run's last tick is in the log.
  [[nodiscard]] bool is_all_written() const { return written_ == num_ticks_ - 1; }

 private:
  [[nodiscard]] bool is_complete(std::int64_t tick) const;

  std::int64_t num_ticks_;
  std::array<std::size_t, num_slots> longest_;
  MessageRing ring_;
  std::int64_t written_ = -1;  ///< last tick in the log without a gap
  std::int64_t newest_ = -1;   ///< newest tick with a received message other than the reference
  Ack acked_;                  ///< the acknowledgement returned last
  std::int64_t newest_acked_ = -1;  ///< `newest_` at that acknowledgement
  /// The plant has repeated a message, because it lacks an acknowledgement.
  bool asked_again_ = false;
  bool filled_late_ = false;  ///< a gap has been filled since the last acknowledgement
};

}  // namespace tachless::session

#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "base/tick_ring.h"

/// The tick protocol as pure state machines: they take events and times and return actions. They
/// neither send nor receive, and they know no message type. docs/protocol.md describes the whole
/// protocol.
namespace tachless::session {

/// Outcome of one received message.
enum class Receipt {
  fresh,        ///< accepted as new
  repeated,     ///< same bytes as before
  not_asked,    ///< belongs to a tick that was not requested
  too_old,      ///< belongs to a tick whose messages are no longer kept
  conflicting,  ///< other bytes than before for the same tick, so two processes have one role
};

/// Returns a digest that distinguishes messages within one process. Its seed is random: no other
/// process can choose a second message with the digest of the first.
std::uint64_t digest_of(std::span<const std::byte> bytes);

/// The messages of the last `depth` ticks, with a fixed number of kinds per tick. A message is kept
/// as its bytes, or as a digest if a copy has only to be recognised. The memory is preallocated.
class MessageRing {
 public:
  /// Number of kept ticks, more than the window (TickMaster::Config) plus one tick for the
  /// reference, which is ahead.
  static constexpr std::int64_t depth = 64;

  /// Capacity of a kind whose messages are kept as digests.
  static constexpr std::size_t digest_only = 0;

  /// @param capacities longest message of each kind [bytes], or digest_only
  explicit MessageRing(std::span<const std::size_t> capacities);

  /// Keeps a message. A tick newer than all earlier ones drops the tick `depth` before it.
  /// @return fresh, repeated, conflicting or too_old; only `fresh` changes what is kept.
  /// @throw std::logic_error on a negative tick or a message longer than its kind's capacity.
  Receipt put(std::int64_t tick, int kind, std::span<const std::byte> bytes);

  [[nodiscard]] bool has(std::int64_t tick, int kind) const { return find(tick, kind) != nullptr; }

  /// Returns the kept bytes; empty for a kind that is kept as a digest.
  /// @throw std::logic_error if no message of that tick is kept
  [[nodiscard]] std::span<const std::byte> bytes(std::int64_t tick, int kind) const;

 private:
  struct Message {
    bool present = false;
    bool digest_only = false;
    std::uint64_t digest = 0;
    std::vector<std::byte> bytes;
  };
  struct Slot {
    std::int64_t tick = -1;
    std::vector<Message> messages;
  };

  [[nodiscard]] const Message* find(std::int64_t tick, int kind) const;

  base::TickRing<Slot> slots_{depth};
};

}  // namespace tachless::session

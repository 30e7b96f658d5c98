#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

/// The tick protocol as pure state machines: events go in, actions come out, time is a value. The
/// state machines neither send nor receive, and know no message type. docs/protocol.md describes
/// the protocol as a whole.
namespace tachless::session {

/// Outcome of one received message.
enum class Verdict {
  fresh,        ///< taken
  repeated,     ///< the same bytes as before
  not_asked,    ///< of a tick that was not requested
  too_old,      ///< of a tick whose messages are no longer kept
  conflicting,  ///< other bytes than before for the same tick: two processes have one role
};

/// Returns a digest that tells messages apart within one process. Its seed is random: no other
/// process can choose a second message with the digest of the first.
std::uint64_t digest_of(std::span<const std::byte> bytes);

/// The messages of the last `depth` ticks, with a fixed number of kinds per tick. Each message is
/// kept once: its bytes, or a digest where a copy has only to be recognised. Preallocated.
class MessageRing {
 public:
  /// More than the window (TickMaster::Config) plus one tick, by which the reference is ahead.
  static constexpr std::int64_t depth = 64;

  /// For `capacities`: the kind's messages are kept as digests.
  static constexpr std::size_t digest_only = 0;

  /// `capacities`: longest message of each kind [bytes], or digest_only.
  explicit MessageRing(std::span<const std::size_t> capacities);

  /// Keeps a message. A tick that is newer than all before drops the tick `depth` earlier.
  /// @return fresh, repeated, conflicting or too_old; only `fresh` changes what is kept.
  /// @throw std::logic_error on a negative tick or a message longer than its kind's capacity.
  Verdict put(std::int64_t tick, int kind, std::span<const std::byte> bytes);

  [[nodiscard]] bool has(std::int64_t tick, int kind) const { return find(tick, kind) != nullptr; }

  /// Returns the kept bytes; none of a kind that is kept as a digest.
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

  std::vector<Slot> slots_;
};

}  // namespace tachless::session

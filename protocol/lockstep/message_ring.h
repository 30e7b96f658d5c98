#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "protocol/lockstep/verdict.h"

namespace tachless::protocol::lockstep {

/// The messages of the last `depth` ticks, a fixed number of kinds per tick, each kept once with
/// its sender. Preallocated.
class MessageRing {
 public:
  /// More than the window (TickMaster::Config) plus one tick, by which the reference is ahead.
  static constexpr std::int64_t depth = 64;

  /// `capacities`: longest message of each kind [bytes].
  explicit MessageRing(std::span<const std::size_t> capacities);

  /// Keeps a message. A tick newer than all before drops the tick `depth` earlier.
  /// @return fresh, repeated, conflicting or too_old; only `fresh` changes what is kept.
  /// @throw std::logic_error on a negative tick or a message longer than its kind's capacity.
  Verdict put(std::int64_t tick, int kind, std::span<const std::byte> bytes,
              std::string_view sender = {});

  [[nodiscard]] bool has(std::int64_t tick, int kind) const;

  /// @throw std::logic_error when there is none.
  [[nodiscard]] std::span<const std::byte> bytes(std::int64_t tick, int kind) const;
  [[nodiscard]] std::string_view sender(std::int64_t tick, int kind) const;

 private:
  static constexpr std::size_t longest_sender = 64;
  struct Message {
    bool present = false;
    std::vector<std::byte> bytes;
    std::array<char, longest_sender> sender{};
    std::size_t sender_size = 0;
  };
  struct Slot {
    std::int64_t tick = -1;
    std::vector<Message> messages;
  };

  [[nodiscard]] const Message* find(std::int64_t tick, int kind) const;

  std::vector<Slot> slots_;
};

}  // namespace tachless::protocol::lockstep

#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

/// The tick protocol as pure state machines: events in, actions out, time passed in as a value.
/// They neither send nor receive, know no message type, and compute no message. docs/protocol.md
/// describes the protocol as a whole.
namespace tachless::protocol::lockstep {

/// What was done with one message.
enum class Verdict {
  fresh,        ///< taken
  repeated,     ///< the same bytes as before
  not_asked,    ///< of a tick that was not requested
  too_old,      ///< of a tick whose messages are no longer kept
  conflicting,  ///< other bytes than before for the same tick: two processes have one role
};

/// The messages of the last `depth` ticks, a fixed number of kinds per tick, each kept once with
/// its sender. Preallocated.
class MessageRing {
 public:
  /// More than the window (TickMaster::Config) plus one tick, by which the reference is ahead.
  static constexpr std::int64_t depth = 64;

  /// `capacities`: longest message of each kind [bytes].
  explicit MessageRing(std::span<const std::size_t> capacities) : slots_(depth) {
    for (Slot& slot : slots_) {
      for (const std::size_t capacity : capacities) {
        slot.messages.emplace_back().bytes.reserve(capacity);
      }
    }
  }

  /// Keeps a message. A tick newer than all before drops the tick `depth` earlier.
  /// @return fresh, repeated, conflicting or too_old; only `fresh` changes what is kept.
  /// @throw std::logic_error on a negative tick or a message longer than its kind's capacity.
  Verdict put(std::int64_t tick, int kind, std::span<const std::byte> bytes,
              std::string_view sender = {}) {
    if (tick < 0) throw std::logic_error("message of tick " + std::to_string(tick) + " kept");
    Slot& slot = slots_[static_cast<std::size_t>(tick % depth)];
    if (tick < slot.tick) return Verdict::too_old;
    if (tick > slot.tick) {
      slot.tick = tick;
      for (Message& message : slot.messages) message.present = false;
    }
    Message& message = slot.messages[static_cast<std::size_t>(kind)];
    if (message.present) {
      return std::ranges::equal(message.bytes, bytes) ? Verdict::repeated : Verdict::conflicting;
    }
    if (bytes.size() > message.bytes.capacity()) {
      throw std::logic_error("message of " + std::to_string(bytes.size()) +
                             " bytes kept in a place for " +
                             std::to_string(message.bytes.capacity()));
    }
    message.bytes.assign(bytes.begin(), bytes.end());
    message.sender_size = std::min(sender.size(), message.sender.size());
    std::copy_n(sender.begin(), message.sender_size, message.sender.begin());
    message.present = true;
    return Verdict::fresh;
  }

  [[nodiscard]] bool has(std::int64_t tick, int kind) const { return find(tick, kind) != nullptr; }

  /// @throw std::logic_error when there is none.
  [[nodiscard]] std::span<const std::byte> bytes(std::int64_t tick, int kind) const {
    return at(tick, kind).bytes;
  }
  [[nodiscard]] std::string_view sender(std::int64_t tick, int kind) const {
    const Message& message = at(tick, kind);
    return {message.sender.data(), message.sender_size};
  }

 private:
  struct Message {
    bool present = false;
    std::vector<std::byte> bytes;
    std::array<char, 64> sender{};
    std::size_t sender_size = 0;
  };
  struct Slot {
    std::int64_t tick = -1;
    std::vector<Message> messages;
  };

  [[nodiscard]] const Message* find(std::int64_t tick, int kind) const {
    if (tick < 0) return nullptr;
    const Slot& slot = slots_[static_cast<std::size_t>(tick % depth)];
    const Message& message = slot.messages[static_cast<std::size_t>(kind)];
    return slot.tick == tick && message.present ? &message : nullptr;
  }
  [[nodiscard]] const Message& at(std::int64_t tick, int kind) const {
    const Message* message = find(tick, kind);
    if (!message) throw std::logic_error("no message of tick " + std::to_string(tick) + " is kept");
    return *message;
  }

  std::vector<Slot> slots_;
};

}  // namespace tachless::protocol::lockstep

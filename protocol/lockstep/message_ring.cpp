#include "protocol/lockstep/message_ring.h"

#include <algorithm>
#include <stdexcept>
#include <string>

namespace tachless::protocol::lockstep {

MessageRing::MessageRing(std::span<const std::size_t> capacities) : slots_(depth) {
  for (Slot& slot : slots_) {
    slot.messages.resize(capacities.size());
    for (std::size_t kind = 0; kind < capacities.size(); ++kind) {
      slot.messages[kind].bytes.reserve(capacities[kind]);
    }
  }
}

Verdict MessageRing::put(std::int64_t tick, int kind, std::span<const std::byte> bytes,
                         std::string_view sender) {
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
  message.sender_size = std::min(sender.size(), longest_sender);
  std::copy_n(sender.begin(), message.sender_size, message.sender.begin());
  message.present = true;
  return Verdict::fresh;
}

const MessageRing::Message* MessageRing::find(std::int64_t tick, int kind) const {
  if (tick < 0) return nullptr;
  const Slot& slot = slots_[static_cast<std::size_t>(tick % depth)];
  if (slot.tick != tick) return nullptr;
  const Message& message = slot.messages[static_cast<std::size_t>(kind)];
  return message.present ? &message : nullptr;
}

bool MessageRing::has(std::int64_t tick, int kind) const { return find(tick, kind) != nullptr; }

std::span<const std::byte> MessageRing::bytes(std::int64_t tick, int kind) const {
  const Message* message = find(tick, kind);
  if (!message) throw std::logic_error("no message of tick " + std::to_string(tick) + " is kept");
  return message->bytes;
}

std::string_view MessageRing::sender(std::int64_t tick, int kind) const {
  const Message* message = find(tick, kind);
  if (!message) throw std::logic_error("no message of tick " + std::to_string(tick) + " is kept");
  return {message->sender.data(), message->sender_size};
}

}  // namespace tachless::protocol::lockstep

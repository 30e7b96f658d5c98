#include "session/message_ring.h"

#include <algorithm>
#include <random>
#include <stdexcept>
#include <string>

#include "base/fnv.h"

namespace tachless::session {

std::uint64_t digest_of(std::span<const std::byte> bytes) {
  static const std::uint64_t seed =
      std::uint64_t{std::random_device()()} << 32 | std::random_device()();
  return base::fnv({reinterpret_cast<const char*>(bytes.data()), bytes.size()}, seed);
}

MessageRing::MessageRing(std::span<const std::size_t> capacities) {
  for (std::int64_t tick = 0; tick < depth; ++tick) {
    for (const std::size_t capacity : capacities) {
      Message& message = slots_[tick].messages.emplace_back();
      message.digest_only = capacity == digest_only;
      message.bytes.reserve(capacity);
    }
  }
}

Receipt MessageRing::put(std::int64_t tick, int kind, std::span<const std::byte> bytes) {
  if (tick < 0) throw std::logic_error("message of tick " + std::to_string(tick) + " kept");
  Slot& slot = slots_[tick];
  if (tick < slot.tick) return Receipt::too_old;
  if (tick > slot.tick) {
    slot.tick = tick;
    for (Message& message : slot.messages) message.present = false;
  }
  Message& message = slot.messages[static_cast<std::size_t>(kind)];
  const std::uint64_t digest = message.digest_only ? digest_of(bytes) : 0;
  if (message.present) {
    const bool same =
        message.digest_only ? message.digest == digest : std::ranges::equal(message.bytes, bytes);
    return same ? Receipt::repeated : Receipt::conflicting;
  }
  if (!message.digest_only && bytes.size() > message.bytes.capacity()) {
    throw std::logic_error("message of " + std::to_string(bytes.size()) +
                           " bytes kept in a place for " +
                           std::to_string(message.bytes.capacity()));
  }
  message.present = true;
  message.digest = digest;
  if (!message.digest_only) message.bytes.assign(bytes.begin(), bytes.end());
  return Receipt::fresh;
}

std::span<const std::byte> MessageRing::bytes(std::int64_t tick, int kind) const {
  const Message* message = find(tick, kind);
  if (!message) throw std::logic_error("no message of tick " + std::to_string(tick) + " is kept");
  return message->bytes;
}

const MessageRing::Message* MessageRing::find(std::int64_t tick, int kind) const {
  if (tick < 0) return nullptr;
  const Slot& slot = slots_[tick];
  const Message& message = slot.messages[static_cast<std::size_t>(kind)];
  return slot.tick == tick && message.present ? &message : nullptr;
}

}  // namespace tachless::session

#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "base/clock.h"

namespace tachless::bus {

/// One message received from the bus. Its views stay valid until the next `receive`.
struct Datagram {
  std::string_view channel;
  std::span<const std::byte> payload;
  std::string_view sender;  ///< address of the sender, for messages to people ("10.0.0.2:41234")
  // Set only after UdpTransport::subscribe_all:
  std::uint32_t sequence = 0;    ///< the sender's count of all its messages, from 0
  std::int64_t received_ns = 0;  ///< the kernel's stamp [ns since the Unix epoch]
  /// Number that `subscribe` returned for the channel; -1 without a subscription to it.
  int channel_number = -1;
};

/// Base of transports, which send and receive opaque messages by channel name. A transport knows
/// nothing of types, ticks or runs. It may lose, duplicate and reorder messages. `publish` never
/// blocks.
class Transport {
 public:
  Transport() = default;
  Transport(const Transport&) = delete;
  Transport& operator=(const Transport&) = delete;
  virtual ~Transport() = default;

  /// Subscribes to exactly this channel; `receive` does not yield own messages.
  /// @return the channel's number, from 0 in the order of first subscriptions
  virtual int subscribe(const std::string& channel) = 0;

  virtual void publish(std::string_view channel, std::span<const std::byte> payload) = 0;

  /// Returns the next message of a subscribed channel. Returns nullopt if `deadline` passes first
  /// or a signal interrupts the wait. A deadline in the past polls.
  virtual std::optional<Datagram> receive(base::Clock::time_point deadline) = 0;
};

}  // namespace tachless::bus

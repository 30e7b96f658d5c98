#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "bus/lcm_url.h"
#include "loop/clock.h"

namespace tachless::bus {

/// One message as it came from the bus. Views stay valid until the next `receive`.
struct Datagram {
  std::string_view channel;
  std::span<const std::byte> payload;
  std::string_view sender;  ///< where it came from, for messages to people ("10.0.0.2:41234")
  // For who listens to a whole bus:
  std::uint32_t sequence = 0;    ///< the sender's count of all its messages, from 0
  std::int64_t received_ns = 0;  ///< the kernel's stamp [ns since the Unix epoch]
};

/// Sends and receives opaque messages by channel name. Knows nothing of types, ticks or runs, may
/// lose, duplicate and reorder. `publish` never blocks (over TCP: while the connection is full).
class Transport {
 public:
  Transport() = default;
  Transport(const Transport&) = delete;
  Transport& operator=(const Transport&) = delete;
  virtual ~Transport() = default;

  /// From now on `receive` yields messages of exactly this channel. Own messages are not received.
  virtual void subscribe(const std::string& channel) = 0;

  virtual void publish(std::string_view channel, std::span<const std::byte> payload) = 0;

  /// The next message of a subscribed channel; nothing if `deadline` passes first or a signal
  /// interrupts the wait. A deadline in the past polls.
  virtual std::optional<Datagram> receive(loop::Clock::time_point deadline) = 0;
};

/// Counts since construction; of a bus over TCP only the first two.
struct BusStatistics {
  std::uint64_t received = 0;    ///< handed out
  std::uint64_t own = 0;         ///< own messages that came back and were passed over
  std::uint64_t malformed = 0;   ///< not an LCM message; counted after `subscribe_all` only, since
                                 ///< otherwise the kernel's filter drops them
  std::uint64_t fragmented = 0;  ///< messages in fragments, which are not supported
  std::uint64_t unsent = 0;      ///< refused by the kernel: no room, no route, firewall
  int refusal = 0;               ///< errno of the last one of these
  /// Datagrams that this transport lost because its buffer was full. Known after `subscribe_all`
  /// only: the kernel counts what a filter drops alike.
  std::optional<std::uint64_t> overflowed;
};

/// A bus for who listens to all of it.
class MonitoredBus : public Transport {
 public:
  /// From now on `receive` yields every message on the bus, with sequence number and time.
  virtual void subscribe_all() = 0;
  [[nodiscard]] virtual BusStatistics statistics() const = 0;
  /// That the kernel granted [bytes].
  [[nodiscard]] virtual int receive_buffer_bytes() const = 0;
};

/// A transport on the bus that the URL names.
/// @throw std::system_error if the host or the server refuses, with what was refused and what to do
std::unique_ptr<MonitoredBus> open_bus(const LcmUrl& url);

}  // namespace tachless::bus

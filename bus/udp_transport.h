#pragma once

#include <netinet/in.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "bus/lcm_url.h"
#include "bus/transport.h"
#include "process/file_descriptor.h"

namespace tachless::bus {

/// What a monitor of the bus wants to know of a datagram besides.
struct RawDatagram {
  Datagram datagram;
  std::uint32_t sequence = 0;    ///< the sender's count of all its messages, from 0
  std::int64_t received_ns = 0;  ///< the kernel's stamp [ns since the Unix epoch]
};

/// Counts since construction.
struct UdpStatistics {
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
  /// The same, of all UDP sockets of this host (network namespace) together.
  std::uint64_t host_overflowed = 0;
};

/// LCM's wire format over UDP multicast, read and written by ourselves: no thread, no copy through
/// a queue, no allocation per message, and a filter in the kernel that wakes the process for its
/// own channels only. Interoperates with liblcm's udpm. Does not put fragments together: a message
/// must fit one datagram. One transport serves one thread.
///
/// A wait lets SIGINT and SIGTERM through even where they are blocked. Block them (and install a
/// handler) for the rest of the time: then a signal ends the present or the next wait, and none
/// falls between two.
class UdpTransport final : public Transport {
 public:
  /// Joins the bus. @param url see `parse_lcm_url`
  /// @throw std::invalid_argument for a URL that cannot be used
  /// @throw std::system_error if the host refuses, with what was refused and what to do
  explicit UdpTransport(const std::string& url = "");
  explicit UdpTransport(const LcmUrl& url);

  /// @throw std::invalid_argument unless the name has 1 to 63 characters and no NUL
  void subscribe(const std::string& channel) override;

  /// From now on `receive` and `receive_raw` yield every message on the bus.
  void subscribe_all();

  /// Never waits: what the kernel does not take at once is lost and counted.
  /// @throw std::length_error if channel and payload together exceed one datagram (65,498 bytes)
  /// @throw std::invalid_argument for a channel name as above
  void publish(std::string_view channel, std::span<const std::byte> payload) override;

  std::optional<Datagram> receive(loop::Clock::time_point deadline) override;

  /// From now on the kernel stamps what arrives.
  void stamp_arrivals();

  /// As `receive`, with sequence number and time. Precondition: `subscribe_all` or `stamp_arrivals`
  /// was called.
  std::optional<RawDatagram> receive_raw(loop::Clock::time_point deadline);

  /// What `other` sends is passed over, as if it were this one's own.
  void regard_as_own(const UdpTransport& other) { own_address_ = other.own_address_; }

  /// Readable when there may be something to receive.
  [[nodiscard]] int descriptor() const { return receiver_.get(); }

  [[nodiscard]] UdpStatistics statistics() const;
  [[nodiscard]] const LcmUrl& url() const { return url_; }

  /// Receive buffer that the kernel granted [bytes], comparable with net.core.rmem_max.
  [[nodiscard]] int receive_buffer_bytes() const;

 private:
  struct Sender {
    sockaddr_in address{};
    std::array<char, 32> text{};
    std::size_t size = 0;
  };

  enum class Wake { datagram, deadline, signal };

  Wake wait(loop::Clock::time_point deadline, bool for_datagram);
  std::optional<RawDatagram> next(loop::Clock::time_point deadline);
  std::optional<RawDatagram> parse(std::size_t size, const sockaddr_in& from);
  std::string_view name_of(const sockaddr_in& from);
  [[nodiscard]] std::uint64_t socket_drops() const;

  LcmUrl url_;
  process::FileDescriptor receiver_;
  process::FileDescriptor sender_;
  sockaddr_in own_address_{};
  std::vector<std::string> channels_;
  bool all_ = false;
  bool stamped_ = false;
  std::uint32_t sequence_ = 0;
  std::vector<std::byte> buffer_;
  std::array<Sender, 8> senders_{};
  std::size_t next_sender_ = 0;
  int reads_since_wait_ = 0;
  UdpStatistics statistics_;
  std::uint64_t drops_before_ = 0;
  std::uint64_t host_overflowed_before_ = 0;
};

}  // namespace tachless::bus

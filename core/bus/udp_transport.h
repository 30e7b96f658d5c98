#pragma once

#include <netinet/in.h>
#include <sys/socket.h>

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/file_descriptor.h"
#include "bus/lcm_url.h"
#include "bus/subscriptions.h"
#include "bus/transport.h"

namespace tachless::bus {

/// Counts since construction.
struct BusStatistics {
  std::uint64_t received = 0;  ///< returned by `receive`
  std::uint64_t own = 0;       ///< own messages that came back and were ignored
  /// Datagrams that are no LCM message. They are counted only after `subscribe_all`, because the
  /// kernel's filter drops them before.
  std::uint64_t malformed = 0;
  std::uint64_t fragmented = 0;  ///< messages in fragments, which are not supported
  std::uint64_t unsent = 0;      ///< refused by the kernel: no room, no route, firewall
  int refusal = 0;               ///< errno of the last unsent message
  /// Datagrams lost because this transport's buffer was full. Known only after `subscribe_all`:
  /// before it, the kernel's counter also includes datagrams that the filter rejects.
  std::optional<std::uint64_t> overflowed;
};

/// Transport over UDP multicast in LCM's wire format: no thread, no queue, no allocation per
/// message, and several datagrams per system call. A filter in the kernel wakes the process for its
/// own channels only. The transport interoperates with liblcm's udpm. It does not reassemble
/// fragments: a message must fit one datagram. One transport serves one thread. A handled signal
/// ends a wait.
class UdpTransport final : public Transport {
 public:
  /// Joins the bus.
  /// @throw std::system_error with the failed operation and its remedy if the host refuses
  explicit UdpTransport(const LcmUrl& url = {});

  /// @throw std::invalid_argument unless the name has 1 to 63 characters and no NUL
  /// @return the channel's number, which `receive` states with each message of it
  int subscribe(const std::string& channel) override;

  /// Makes `receive` yield every message on the bus from now on, with sequence number and time.
  void subscribe_all();

  /// Sends without waiting: a message that the kernel does not take at once is lost and counted.
  /// @throw std::length_error if channel and payload together exceed one datagram (65,498 bytes)
  /// @throw std::invalid_argument for a channel name that `subscribe` refuses
  void publish(std::string_view channel, std::span<const std::byte> payload) override;

  /// Waits for a message of a subscribed channel until the deadline.
  /// @return nothing at the deadline, or after a handled signal; the message is valid until the
  /// next call
  std::optional<Datagram> receive(base::Clock::time_point deadline) override;

  /// Lets a wait for datagrams begin with a pause of this length from now on, so that one wake-up
  /// reads many. 0: no pause. Use it only in a process for whose replies no other process waits.
  void read_in_batches(std::chrono::nanoseconds pause) { pause_ = pause; }

  /// Returns the counts since construction.
  [[nodiscard]] BusStatistics statistics() const;
  /// Returns the address of the bus.
  [[nodiscard]] const LcmUrl& url() const { return url_; }

  /// Returns the receive buffer that the kernel granted [bytes], comparable with net.core.rmem_max.
  [[nodiscard]] int receive_buffer_bytes() const;

 private:
  struct Sender {
    sockaddr_in address{};
    std::array<char, 32> text{};
    std::size_t size = 0;
  };

  /// Most datagrams that one system call reads.
  static constexpr int batch = 16;
  struct Held {
    sockaddr_in from{};
    iovec part{};
    alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(timespec))> control{};
  };
  /// @return as `poll_until`
  int wait(base::Clock::time_point deadline, bool for_datagram);
  bool read_batch();
  bool fetch(base::Clock::time_point deadline, bool passed_over);
  std::optional<Datagram> parse(std::span<const std::byte> bytes, const sockaddr_in& from);
  std::string_view name_of(const sockaddr_in& from);
  [[nodiscard]] std::uint64_t socket_drops() const;

  LcmUrl url_;
  base::FileDescriptor receiver_;
  base::FileDescriptor sender_;
  sockaddr_in own_address_{};
  Subscriptions channels_;
  bool all_ = false;
  std::uint32_t sequence_ = 0;
  std::vector<std::byte> buffer_;
  std::array<Held, batch> held_{};
  std::array<mmsghdr, batch> headers_{};
  int num_held_ = 0;
  int next_held_ = 0;
  std::chrono::nanoseconds pause_{0};
  std::array<Sender, 8> senders_{};
  std::size_t next_sender_ = 0;
  BusStatistics statistics_;
  std::uint64_t drops_before_ = 0;
};

}  // namespace tachless::bus

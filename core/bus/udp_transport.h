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

/// LCM's wire format over UDP multicast: no thread, no queue, no allocation per message, several
/// datagrams per system call, and a filter in the kernel that wakes the process for its own
/// channels only. Interoperates with liblcm's udpm. Does not reassemble fragments: a message must
/// fit one datagram. One transport serves one thread. A signal that is handled ends a wait.
class UdpTransport final : public Transport {
 public:
  /// Joins the bus.
  /// @throw std::system_error if the host refuses, with what was refused and what to do
  explicit UdpTransport(const LcmUrl& url = {});

  /// @throw std::invalid_argument unless the name has 1 to 63 characters and no NUL
  int subscribe(const std::string& channel) override;

  /// From now on `receive` yields every message on the bus, with sequence number and time.
  void subscribe_all();

  /// Never waits: what the kernel does not take at once is lost and counted.
  /// @throw std::length_error if channel and payload together exceed one datagram (65,498 bytes)
  /// @throw std::invalid_argument for a channel name as above
  void publish(std::string_view channel, std::span<const std::byte> payload) override;

  std::optional<Datagram> receive(base::Clock::time_point deadline) override;

  /// From now on a wait for datagrams begins with a pause of this length, so that one wake-up reads
  /// many. For a process on whose replies no other waits. 0: no pause.
  void read_in_batches(std::chrono::nanoseconds pause) { pause_ = pause; }

  [[nodiscard]] BusStatistics statistics() const;
  [[nodiscard]] const LcmUrl& url() const { return url_; }

  /// Receive buffer that the kernel granted [bytes], comparable with net.core.rmem_max.
  [[nodiscard]] int receive_buffer_bytes() const;

 private:
  struct Sender {
    sockaddr_in address{};
    std::array<char, 32> text{};
    std::size_t size = 0;
  };

  /// Room for what one call of the kernel yields.
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

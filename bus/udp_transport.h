#pragma once

#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "bus/lcm_url.h"
#include "bus/transport.h"
#include "process/file_descriptor.h"

namespace tachless::bus {

/// LCM's wire format over UDP multicast, read and written by ourselves: no thread, no copy through
/// a queue, no allocation per message, what waits read at once, and a filter in the kernel that
/// wakes the process for its own channels only. Interoperates with liblcm's udpm. Does not put
/// fragments together: a message must fit one datagram. One transport serves one thread. A signal
/// that is handled ends a wait.
class UdpTransport final : public MonitoredBus {
 public:
  /// Joins the bus. @param url see `parse_lcm_url`
  /// @throw std::invalid_argument for a URL that cannot be used
  /// @throw std::system_error if the host refuses, with what was refused and what to do
  explicit UdpTransport(const std::string& url = "");
  explicit UdpTransport(const LcmUrl& url);

  /// @throw std::invalid_argument unless the name has 1 to 63 characters and no NUL
  void subscribe(const std::string& channel) override;

  void subscribe_all() override;

  /// Never waits: what the kernel does not take at once is lost and counted.
  /// @throw std::length_error if channel and payload together exceed one datagram (65,498 bytes)
  /// @throw std::invalid_argument for a channel name as above
  void publish(std::string_view channel, std::span<const std::byte> payload) override;

  std::optional<Datagram> receive(loop::Clock::time_point deadline) override;

  /// From now on the kernel stamps what arrives, as after `subscribe_all`.
  void stamp_arrivals();

  /// What `other` sends is passed over, as if it were this one's own.
  void regard_as_own(const UdpTransport& other) { own_address_ = other.own_address_; }

  /// Before each wait for datagrams this process sleeps, so that they collect and it is woken once
  /// for many: so long that about `messages` of them come, at most `longest`, and less where they
  /// would fill the receive buffer. For who is not waited for.
  void collect(int messages, std::chrono::nanoseconds longest);

  /// From now on this process does not sleep while it waits for datagrams: for who has a CPU for
  /// itself.
  void spin() { spin_ = true; }

  /// Whether datagrams have been read that are not handed out yet. Otherwise `descriptor` is
  /// readable when there may be something to receive.
  [[nodiscard]] bool holds_datagrams() const { return next_held_ < num_held_; }
  [[nodiscard]] int descriptor() const { return receiver_.get(); }

  [[nodiscard]] BusStatistics statistics() const override;
  [[nodiscard]] const LcmUrl& url() const { return url_; }

  /// Receive buffer that the kernel granted [bytes], comparable with net.core.rmem_max.
  [[nodiscard]] int receive_buffer_bytes() const override;

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
  /// How long to sleep before a wait (see `collect`).
  struct Nap {
    int messages = 0;      ///< wanted each time
    std::size_t room = 0;  ///< of the receive buffer for them [bytes]
    std::chrono::nanoseconds longest{0};
    std::chrono::nanoseconds length{0};
    int come = 0;              ///< messages since the last one
    std::size_t occupied = 0;  ///< by these
  };

  /// @return as `poll_until`
  int wait(loop::Clock::time_point deadline, bool for_datagram);
  int nap(loop::Clock::time_point deadline);
  bool read_batch();
  bool fetch(loop::Clock::time_point deadline, bool passed_over);
  std::optional<Datagram> parse(std::span<const std::byte> bytes, const sockaddr_in& from);
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
  std::array<Held, batch> held_{};
  std::array<mmsghdr, batch> headers_{};
  int num_held_ = 0;
  int next_held_ = 0;
  std::optional<Nap> nap_;
  bool spin_ = false;
  std::array<Sender, 8> senders_{};
  std::size_t next_sender_ = 0;
  BusStatistics statistics_;
  std::uint64_t drops_before_ = 0;
};

/// A bus that is heard through one socket per channel, so that the receive buffer which the kernel
/// grants is granted once for each: for who must not lose bursts where `net.core.rmem_max` is
/// small. Yields messages in order of their arrival. Costs every sender a little more, for the
/// kernel offers each datagram to each socket.
class ChannelwiseTransport final : public Transport {
 public:
  /// @param sender publishes for it, and must outlive it. It should be subscribed to nothing.
  explicit ChannelwiseTransport(UdpTransport& sender) : sender_(sender) {}

  /// @throw as UdpTransport's constructor and `subscribe`
  void subscribe(const std::string& channel) override;
  void publish(std::string_view channel, std::span<const std::byte> payload) override {
    sender_.publish(channel, payload);
  }
  std::optional<Datagram> receive(loop::Clock::time_point deadline) override;

 private:
  struct Box {
    Box(const std::string& name, const LcmUrl& url) : channel(name), transport(url) {}
    std::string channel;
    UdpTransport transport;
    std::optional<Datagram> first;  ///< the oldest that has not been yielded
  };

  /// False at the deadline or a signal.
  bool look_into_empty_boxes(loop::Clock::time_point deadline);
  Box* oldest();

  UdpTransport& sender_;
  std::deque<Box> boxes_;            // which stay where they are
  std::vector<pollfd> descriptors_;  // in the same order
  Box* yielded_ = nullptr;           ///< whose message is in the caller's hands
};

}  // namespace tachless::bus

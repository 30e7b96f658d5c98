#pragma once

#include <poll.h>

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "bus/transport.h"
#include "bus/udp_transport.h"

namespace tachless::bus {

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
    std::string channel;
    std::unique_ptr<UdpTransport> transport;
    std::optional<RawDatagram> first;  ///< the oldest that has not been yielded
  };
  enum class Wake { looked, deadline, signal };

  Wake look_into_empty_boxes(loop::Clock::time_point deadline);
  Box* oldest();

  UdpTransport& sender_;
  std::vector<Box> boxes_;
  std::vector<pollfd> descriptors_;
  Box* yielded_ = nullptr;  ///< whose message is in the caller's hands
};

}  // namespace tachless::bus

#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "base/file_descriptor.h"
#include "bus/udp_transport.h"
#include "messages/wire.h"

namespace tachless::campaign {

/// An outsider's endpoint on the real bus. After it has received an announcement of the chosen
/// member, its datagrams have that member's address as source, as a host's administrator can
/// arrange. It does not receive its own messages. Precondition: the process is in a network
/// namespace of its own, where all have one host.
class Impostor final : public bus::Transport {
 public:
  /// @param whom "controller's endpoint"; any other text means an outsider
  explicit Impostor(std::string_view whom);

  int subscribe(const std::string& channel) override { return bus_.subscribe(channel); }
  void publish(std::string_view channel, std::span<const std::byte> payload) override;
  std::optional<bus::Datagram> receive(base::Clock::time_point deadline) override;

 private:
  void look_for_member(const bus::Datagram& datagram);

  bus::UdpTransport bus_;
  std::optional<messages::Role> whom_;
  messages::Codec<messages::Participant> codec_{messages::Layout{}};
  base::FileDescriptor raw_;
  std::uint16_t port_ = 0;  ///< the member's port, once it is known
  std::uint32_t sequence_;
};

}  // namespace tachless::campaign

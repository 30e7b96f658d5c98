#pragma once

#include <optional>
#include <string>

#include "bus/lcm_url.h"

namespace tachless::bus {

struct NetworkProblem {
  std::string what;    ///< one line
  std::string remedy;  ///< the command that mends it
};

/// Says within a second whether a message sent to this bus arrives on this host. Sends up to
/// three datagrams with ttl 0 on a channel that no program subscribes to.
/// @return nothing if all is well
std::optional<NetworkProblem> check_network(const LcmUrl& url);

/// The way that a message to the bus takes out of this host.
struct MulticastRoute {
  std::string interface;   ///< "lo", "eth0", …
  bool multicast = false;  ///< the interface's MULTICAST flag
};

/// @return nothing if there is no route to the group
/// @throw std::system_error if no socket can be opened
std::optional<MulticastRoute> multicast_route(const LcmUrl& url);

/// Most that a receive buffer may have without privileges, net.core.rmem_max [bytes].
/// @throw std::runtime_error if it cannot be read
long receive_buffer_limit_bytes();

}  // namespace tachless::bus

#pragma once

#include <optional>
#include <string>

#include "bus/lcm_url.h"

namespace tachless::bus {

struct NetworkProblem {
  std::string what;    ///< one line
  std::string remedy;  ///< shell command that solves the problem
};

/// Checks within a second whether a message sent to this bus arrives on this host. It sends up to
/// three datagrams with ttl 0 on a channel that no program subscribes to.
/// @return the problem, or nullopt if there is none
std::optional<NetworkProblem> check_network(const LcmUrl& url);

/// Interface through which messages to the bus leave this host.
struct MulticastRoute {
  std::string interface;   ///< "lo", "eth0", …
  bool multicast = false;  ///< the interface's MULTICAST flag
};

/// Returns the route to the bus's group.
/// @return nullopt if there is no route to the group
/// @throw std::system_error if no socket can be opened
std::optional<MulticastRoute> multicast_route(const LcmUrl& url);

/// Returns the greatest receive buffer without privileges, net.core.rmem_max [bytes].
/// @throw std::runtime_error if it cannot be read
long receive_buffer_limit_bytes();

}  // namespace tachless::bus

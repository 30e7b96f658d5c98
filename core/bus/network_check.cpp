#include "bus/network_check.h"

#include <arpa/inet.h>
#include <fmt/core.h>
#include <net/if.h>
#include <net/route.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <fstream>
#include <span>
#include <sstream>
#include <stdexcept>
#include <system_error>

#include "base/file_descriptor.h"
#include "bus/key.h"
#include "bus/udp_transport.h"

namespace tachless::bus {
namespace {

using std::chrono::milliseconds;

constexpr int attempts = 3;
constexpr milliseconds patience{250};  // per attempt; loopback takes far less than 1 ms

[[noreturn]] void fail(const std::string& what) {
  throw std::system_error(errno, std::generic_category(), "network check: " + what);
}

/// Returns the flags of an interface; nullopt if it does not exist.
std::optional<short> interface_flags(const std::string& name) {
  const base::FileDescriptor socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (socket.get() < 0) fail("cannot open a socket");
  ifreq request{};
  name.copy(request.ifr_name, IFNAMSIZ - 1);
  if (::ioctl(socket.get(), SIOCGIFFLAGS, &request) != 0) return std::nullopt;
  return request.ifr_flags;
}

/// Returns the interface of the narrowest route to the group; empty if there is none.
std::string outgoing_interface(const LcmUrl& url) {
  in_addr group{};
  inet_pton(AF_INET, url.group.c_str(), &group);
  std::ifstream routes("/proc/net/route");
  std::string line, outgoing;
  std::getline(routes, line);  // the columns' names
  std::uint32_t narrowest = 0;
  while (std::getline(routes, line)) {
    std::istringstream fields(line);
    std::string interface;
    std::uint32_t destination = 0, flags = 0, mask = 0, other = 0;
    fields >> interface >> std::hex >> destination >> other >> flags >> other >> other >> other >>
        mask;
    const bool usable = fields && (flags & RTF_UP) != 0 && (flags & RTF_REJECT) == 0;
    if (!usable || (group.s_addr & mask) != destination) continue;
    if (!outgoing.empty() && ntohl(mask) <= narrowest) continue;
    outgoing = interface;
    narrowest = ntohl(mask);
  }
  return outgoing;
}

std::optional<NetworkProblem> problem_of_route(const LcmUrl& url) {
  if (const std::optional<MulticastRoute> route = multicast_route(url)) {
    if (route->multicast) return std::nullopt;
    return NetworkProblem{
        fmt::format("the interface {}, to which the route to {} leads, does not do multicast",
                    route->interface, url.group),
        fmt::format("ip link set {} multicast on", route->interface)};
  }
  const std::optional<short> lo = interface_flags("lo");
  if (lo && (*lo & IFF_UP) == 0) {
    return NetworkProblem{
        fmt::format("the interface lo is down, and there is no route to {}", url.group),
        "ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo"};
  }
  return NetworkProblem{fmt::format("there is no route to the multicast group {}", url.group),
                        "ip route add 224.0.0.0/4 dev lo"};
}

std::optional<NetworkProblem> problem_of_probe(const LcmUrl& url) {
  LcmUrl here = url;
  here.ttl = 0;
  UdpTransport sender(here);
  UdpTransport receiver(here);
  const std::string channel = fmt::format("TACHLESS_NETWORK_CHECK_{}", ::getpid());
  receiver.subscribe(channel);
  // Another program may send on this channel too, so the random number identifies the probe.
  const std::string probe = fmt::format("{} {}", channel, random_number());
  const auto payload = std::as_bytes(std::span(probe));
  for (int i = 0; i < attempts; ++i) {
    sender.publish(channel, payload);
    const auto until = base::Clock::now() + patience;
    while (const auto datagram = receiver.receive(until)) {
      if (std::ranges::equal(datagram->payload, payload)) return std::nullopt;
    }
  }
  const bool refused = sender.statistics().unsent > 0;
  return NetworkProblem{
      fmt::format("messages to {}:{} {} on this host: a firewall drops them (nft list ruleset "
                  "shows it)",
                  url.group, url.port, refused ? "are not let out" : "do not arrive"),
      fmt::format("iptables -I {} -d {} -p udp --dport {} -j ACCEPT", refused ? "OUTPUT" : "INPUT",
                  url.group, url.port)};
}

}  // namespace

std::optional<MulticastRoute> multicast_route(const LcmUrl& url) {
  const std::string interface = outgoing_interface(url);
  if (interface.empty()) return std::nullopt;
  const short flags = interface_flags(interface).value_or(0);
  return MulticastRoute{interface, (flags & IFF_MULTICAST) != 0};
}

std::optional<NetworkProblem> check_network(const LcmUrl& url) {
  try {
    const auto problem = problem_of_route(url);
    return problem ? problem : problem_of_probe(url);
  } catch (const std::system_error& error) {
    if (error.code() == std::errc::address_in_use) {
      return NetworkProblem{fmt::format("another program holds UDP port {} for itself", url.port),
                            "take another port, or end the program that ss -ulpn shows on it"};
    }
    return NetworkProblem{error.what(), "tachless doctor"};
  }
}

long receive_buffer_limit_bytes() {
  const char* path = "/proc/sys/net/core/rmem_max";
  std::ifstream file(path);
  long bytes = 0;
  if (!(file >> bytes)) throw std::runtime_error(std::string("cannot read ") + path);
  return bytes;
}

}  // namespace tachless::bus

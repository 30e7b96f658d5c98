#include "bus/network_check.h"

#include <arpa/inet.h>
#include <fmt/core.h>
#include <linux/netlink.h>
#include <linux/rtnetlink.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <fstream>
#include <span>
#include <stdexcept>
#include <system_error>

#include "bus/udp_transport.h"
#include "process/file_descriptor.h"

namespace tachless::bus {
namespace {

using std::chrono::milliseconds;

constexpr int attempts = 3;
constexpr milliseconds patience{250};  // per attempt; loopback takes far less than 1 ms

[[noreturn]] void fail(const std::string& what) {
  throw std::system_error(errno, std::generic_category(), "network check: " + what);
}

/// Flags of an interface; nothing if it does not exist.
std::optional<short> interface_flags(const std::string& name) {
  const process::FileDescriptor socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (socket.get() < 0) fail("cannot open a socket");
  ifreq request{};
  name.copy(request.ifr_name, IFNAMSIZ - 1);
  if (::ioctl(socket.get(), SIOCGIFFLAGS, &request) != 0) return std::nullopt;
  return request.ifr_flags;
}

/// Asks the kernel's routing table for the outgoing interface; 0 if there is none.
int outgoing_interface(const LcmUrl& url) {
  struct Question {
    nlmsghdr header{};
    rtmsg route{};
    rtattr attribute{};
    in_addr destination{};
  } question;
  question.header.nlmsg_len = sizeof question;
  question.header.nlmsg_type = RTM_GETROUTE;
  question.header.nlmsg_flags = NLM_F_REQUEST;
  question.route.rtm_family = AF_INET;
  question.route.rtm_dst_len = 32;
  question.attribute.rta_type = RTA_DST;
  question.attribute.rta_len = RTA_LENGTH(sizeof question.destination);
  inet_pton(AF_INET, url.group.c_str(), &question.destination);

  const process::FileDescriptor netlink(
      ::socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, NETLINK_ROUTE));
  alignas(nlmsghdr) std::array<char, 8192> answer{};
  if (netlink.get() < 0 || ::send(netlink.get(), &question, sizeof question, 0) < 0) {
    fail("cannot ask for the route");
  }
  const ssize_t size = ::recv(netlink.get(), answer.data(), answer.size(), 0);
  if (size < 0) fail("no answer about the route");
  auto* header = reinterpret_cast<nlmsghdr*>(answer.data());
  if (!NLMSG_OK(header, static_cast<std::size_t>(size)) || header->nlmsg_type != RTM_NEWROUTE) {
    return 0;
  }
  auto* route = static_cast<rtmsg*>(NLMSG_DATA(header));
  auto rest = static_cast<int>(RTM_PAYLOAD(header));
  for (rtattr* a = RTM_RTA(route); RTA_OK(a, rest); a = RTA_NEXT(a, rest)) {
    if (a->rta_type != RTA_OIF) continue;
    int index = 0;
    std::memcpy(&index, RTA_DATA(a), sizeof index);
    return index;
  }
  return 0;
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
  const auto payload = std::as_bytes(std::span(channel));
  for (int i = 0; i < attempts; ++i) {
    sender.publish(channel, payload);
    if (receiver.receive(loop::Clock::now() + patience)) return std::nullopt;
  }
  const bool refused = sender.statistics().unsent > 0;
  return NetworkProblem{
      fmt::format("messages to {}:{} {} on this host: a firewall drops them (`nft list ruleset` "
                  "shows it)",
                  url.group, url.port, refused ? "are not let out" : "do not arrive"),
      fmt::format("iptables -I {} -d {} -p udp --dport {} -j ACCEPT", refused ? "OUTPUT" : "INPUT",
                  url.group, url.port)};
}

}  // namespace

std::optional<MulticastRoute> multicast_route(const LcmUrl& url) {
  const int index = outgoing_interface(url);
  std::array<char, IF_NAMESIZE> name{};
  if (index == 0 || ::if_indextoname(static_cast<unsigned>(index), name.data()) == nullptr) {
    return std::nullopt;
  }
  const short flags = interface_flags(name.data()).value_or(0);
  return MulticastRoute{name.data(), (flags & IFF_UP) != 0, (flags & IFF_MULTICAST) != 0};
}

std::optional<NetworkProblem> check_network(const LcmUrl& url) {
  try {
    const auto problem = problem_of_route(url);
    return problem ? problem : problem_of_probe(url);
  } catch (const std::system_error& error) {
    if (error.code() == std::errc::address_in_use) {
      return NetworkProblem{fmt::format("another program holds UDP port {} for itself", url.port),
                            "take another port, or end the program that `ss -ulpn` shows on it"};
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

#include "tests/system/four_hosts.h"

#include <fcntl.h>
#include <net/if.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <stdexcept>
#include <system_error>

namespace tachless::system_test {
namespace {

void check(int result, const std::string& what) {
  if (result < 0) throw std::system_error(errno, std::generic_category(), "four hosts: " + what);
}

void shell(const std::string& command) {
  if (std::system(command.c_str()) != 0) throw std::runtime_error("four hosts: " + command);
}

}  // namespace

FourHosts::FourHosts() {
  // The names of hosts are ours to change only in a namespace of our own.
  check(unshare(CLONE_NEWUTS), "unshare");
  switch_ = here();
  // A switch that learns who listens from queries that nobody sends would fall silent: it floods.
  shell("ip link add name switch type bridge mcast_snooping 0 && ip link set switch up");
  for (const std::string role : roles) {
    check(unshare(CLONE_NEWNET | CLONE_NEWUTS), "unshare");
    const std::string name = role + "-host";
    check(sethostname(name.data(), name.size()), "sethostname");
    hosts_.push_back(here());
    enter(switch_);
    const std::string network =
        "/proc/" + std::to_string(getpid()) + "/fd/" + std::to_string(hosts_.back().network.get());
    shell("ip link add " + role + " type veth peer name eth0 netns " + network +
          " && ip link set " + role + " master switch up");
    const Visit visit(*this, role);
    shell("ip link set lo up && ip address add 10.76.67." + std::to_string(hosts_.size()) +
          "/24 dev eth0 && ip link set eth0 up && ip route add 224.0.0.0/4 dev eth0");
  }
}

FourHosts::~FourHosts() {
  // At once, not when the kernel comes to it: the next four hosts have the same names.
  const auto remove = [](const std::string& link) {
    const std::string command = "ip link delete " + link;
    if (std::system(command.c_str()) != 0) std::perror(command.c_str());
  };
  for (const std::string role : roles) remove(role);
  remove("switch");
}

FourHosts::Namespaces FourHosts::here() {
  Namespaces result{base::FileDescriptor(open("/proc/self/ns/net", O_RDONLY | O_CLOEXEC)),
                    base::FileDescriptor(open("/proc/self/ns/uts", O_RDONLY | O_CLOEXEC))};
  check(result.network.get(), "/proc/self/ns/net");
  check(result.name.get(), "/proc/self/ns/uts");
  return result;
}

void FourHosts::enter(const Namespaces& namespaces) {
  check(setns(namespaces.network.get(), CLONE_NEWNET), "setns");
  check(setns(namespaces.name.get(), CLONE_NEWUTS), "setns");
}

const FourHosts::Namespaces& FourHosts::of(const std::string& role) const {
  const auto found = std::find(roles.begin(), roles.end(), role);
  return hosts_.at(static_cast<std::size_t>(found - roles.begin()));
}

FourHosts::Visit::Visit(const FourHosts& hosts, const std::string& role) : hosts_(hosts) {
  enter(hosts.of(role));
}

FourHosts::Visit::~Visit() { enter(hosts_.switch_); }

void FourHosts::lose(int percent) const {
  for (const std::string role : roles) {
    const Visit visit(*this, role);
    shell(
        "nft add table ip lossy && "
        "nft 'add chain ip lossy in { type filter hook input priority 0; }' && "
        "nft add rule ip lossy in udp dport 7667 numgen random mod 100 \\< " +
        std::to_string(percent) + " drop");
  }
}

void FourHosts::forbid_sending(const std::string& role) const {
  const Visit visit(*this, role);
  shell(
      "nft add table ip firewall && "
      "nft 'add chain ip firewall out { type filter hook output priority 0; }' && "
      "nft add rule ip firewall out udp dport 7667 drop");
}

void FourHosts::set_port(const std::string& role, bool up) {
  const base::FileDescriptor socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  check(socket.get(), "socket");
  ifreq request{};
  std::strncpy(request.ifr_name, role.c_str(), sizeof request.ifr_name - 1);
  check(ioctl(socket.get(), SIOCGIFFLAGS, &request), "look at " + role);
  if (up) {
    request.ifr_flags |= IFF_UP;
  } else {
    request.ifr_flags &= ~IFF_UP;
  }
  check(ioctl(socket.get(), SIOCSIFFLAGS, &request), "switch " + role);
}

}  // namespace tachless::system_test

#include "bus/udp_socket.h"

#include <arpa/inet.h>

#include <cerrno>
#include <system_error>

#include "bus/channel_filter.h"

namespace tachless::bus {
namespace {

constexpr int wanted_buffer_bytes = 4 << 20;

const char* remedy_for(int error) {
  switch (error) {
    case ENODEV:
    case ENETUNREACH:
    case EADDRNOTAVAIL:
      return "no multicast route: `ip link set lo up multicast on; ip route add 224.0.0.0/4 dev "
             "lo`, or run with --isolate";
    case EADDRINUSE:
      return "a program holds the port for itself: take another port, or find it with `ss -ulpn`";
    default:
      return "`tachless doctor` looks closer";
  }
}

sockaddr_in address_of(const LcmUrl& url) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(url.port);
  inet_pton(AF_INET, url.group.c_str(), &address.sin_addr);
  return address;
}

process::FileDescriptor open_socket(const LcmUrl& url) {
  process::FileDescriptor fd(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (fd.get() < 0) fail_with_errno(url, "cannot open a UDP socket");
  return fd;
}

}  // namespace

void fail_with_errno(const LcmUrl& url, const std::string& what) {
  throw std::system_error(errno, std::generic_category(),
                          "bus " + url.text() + ": " + what + " (" + remedy_for(errno) + ")");
}

void install_filter(const LcmUrl& url, int fd, const std::vector<std::string>& channels) {
  std::vector<sock_filter> program = channel_filter(channels);
  const sock_fprog handle{static_cast<unsigned short>(program.size()), program.data()};
  set(url, fd, SOL_SOCKET, SO_ATTACH_FILTER, handle, "cannot install the channel filter");
}

process::FileDescriptor open_receiver(const LcmUrl& url) {
  process::FileDescriptor fd = open_socket(url);
  install_filter(url, fd.get(), {});  // nothing may queue before the first subscription
  const int on = 1;
  const int off = 0;
  set(url, fd.get(), SOL_SOCKET, SO_REUSEADDR, on, "cannot share the port");
  set(url, fd.get(), SOL_SOCKET, SO_REUSEPORT, on, "cannot share the port");
  const int size = url.receive_buffer_bytes != 0 ? url.receive_buffer_bytes : wanted_buffer_bytes;
  if (::setsockopt(fd.get(), SOL_SOCKET, SO_RCVBUFFORCE, &size, sizeof size) != 0) {
    set(url, fd.get(), SOL_SOCKET, SO_RCVBUF, size, "cannot set the receive buffer");
  }
  // The group's address, not any: other groups on this port are other buses.
  const sockaddr_in address = address_of(url);
  if (::bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    fail_with_errno(url, "cannot bind the port");
  }
  ip_mreq membership{};
  membership.imr_multiaddr = address.sin_addr;
  membership.imr_interface.s_addr = htonl(INADDR_ANY);
  set(url, fd.get(), IPPROTO_IP, IP_ADD_MEMBERSHIP, membership, "cannot join the group");
  set(url, fd.get(), IPPROTO_IP, IP_MULTICAST_ALL, off, "cannot leave other groups");
  return fd;
}

process::FileDescriptor open_sender(const LcmUrl& url) {
  process::FileDescriptor fd = open_socket(url);
  const auto ttl = static_cast<unsigned char>(url.ttl);
  const unsigned char loop = 1;
  set(url, fd.get(), IPPROTO_IP, IP_MULTICAST_TTL, ttl, "cannot set the ttl");
  set(url, fd.get(), IPPROTO_IP, IP_MULTICAST_LOOP, loop, "cannot reach this host");
  const sockaddr_in address = address_of(url);
  if (::connect(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    fail_with_errno(url, "cannot send to the group");
  }
  return fd;
}

}  // namespace tachless::bus

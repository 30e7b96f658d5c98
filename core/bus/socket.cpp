#include "bus/socket.h"

#include <arpa/inet.h>
#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <stdexcept>
#include <system_error>

#include "bus/lcm_packet.h"

namespace tachless::bus {
namespace {

constexpr int wanted_buffer_bytes = 4 << 20;

// A filter of a UDP socket sees the datagram from its UDP header on.
constexpr std::uint32_t udp_header = 8;
constexpr std::uint32_t accept = 0xffffffff;
constexpr std::uint32_t reject = 0;

constexpr std::uint16_t load_word = BPF_LD | BPF_W | BPF_ABS;
constexpr std::uint16_t load_half = BPF_LD | BPF_H | BPF_ABS;
constexpr std::uint16_t load_index = BPF_LDX | BPF_IMM;
constexpr std::uint16_t jump = BPF_JMP | BPF_JA;
constexpr std::uint16_t jump_equal = BPF_JMP | BPF_JEQ | BPF_K;
constexpr std::uint16_t give_back = BPF_RET | BPF_K;

const char* remedy_for(int error) {
  switch (error) {
    case ENODEV:
    case ENETUNREACH:
    case EADDRNOTAVAIL:
      return "no multicast route: ip link set lo up multicast on; ip route add 224.0.0.0/4 dev "
             "lo, or run with --isolate";
    case EADDRINUSE:
      return "a program holds the port for itself: take another port, or find it with ss -ulpn";
    default:
      return "run tachless doctor for details";
  }
}

sockaddr_in address_of(const LcmUrl& url) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(url.port);
  inet_pton(AF_INET, url.group.c_str(), &address.sin_addr);
  return address;
}

base::FileDescriptor open_socket(const LcmUrl& url) {
  base::FileDescriptor fd(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (fd.get() < 0) fail_with_errno(url, "cannot open a UDP socket");
  return fd;
}

/// Appends instructions that accept a channel of this name and continue after them for another
/// name.
void add_name(const std::string& channel, std::vector<sock_filter>& program) {
  const std::size_t size = channel.size() + 1;  // the NUL belongs to the name
  const std::size_t num_pieces = size / 4 + static_cast<std::size_t>(std::popcount(size % 4));
  std::size_t to_next_name = 2 * num_pieces - 1;
  for (std::size_t at = 0, width = 0; at < size; at += width, to_next_name -= 2) {
    width = std::bit_floor(std::min<std::size_t>(size - at, 4));
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < width; ++i) {
      value = value << 8 | static_cast<unsigned char>(channel.c_str()[at + i]);
    }
    // The offset is relative to the index register, which holds the channel's offset.
    static constexpr std::array<int, 5> load_by_width = {0, BPF_B, BPF_H, 0, BPF_W};
    const auto load = static_cast<std::uint16_t>(BPF_LD | BPF_IND | load_by_width[width]);
    program.push_back({load, 0, 0, static_cast<std::uint32_t>(at)});
    program.push_back({jump_equal, 0, static_cast<std::uint8_t>(to_next_name), value});
  }
  program.push_back({give_back, 0, 0, accept});
}

}  // namespace

int poll_until(std::span<pollfd> descriptors, base::Clock::time_point deadline) {
  // The comparison comes first: time_point::min() minus now would overflow into the far future.
  const base::Clock::time_point now = base::Clock::now();
  const base::Clock::duration left =
      deadline > now ? deadline - now : base::Clock::duration::zero();
  const auto left_s = std::chrono::duration_cast<std::chrono::seconds>(left);
  const timespec timeout{left_s.count(), std::chrono::nanoseconds(left - left_s).count()};
  return ::ppoll(descriptors.data(), descriptors.size(), &timeout, nullptr);
}

void fail_with_errno(const LcmUrl& url, const std::string& what) {
  throw std::system_error(errno, std::generic_category(),
                          fmt::format("bus {}: {} ({})", url.text(), what, remedy_for(errno)));
}

base::FileDescriptor open_receiver(const LcmUrl& url) {
  base::FileDescriptor fd = open_socket(url);
  install_filter(url, fd.get(), {});  // no datagram may queue before the first subscription
  set(url, fd.get(), SOL_SOCKET, SO_REUSEADDR, 1, "cannot share the port");
  set(url, fd.get(), SOL_SOCKET, SO_REUSEPORT, 1, "cannot share the port");
  const int size = url.receive_buffer_bytes != 0 ? url.receive_buffer_bytes : wanted_buffer_bytes;
  if (::setsockopt(fd.get(), SOL_SOCKET, SO_RCVBUFFORCE, &size, sizeof size) != 0) {
    set(url, fd.get(), SOL_SOCKET, SO_RCVBUF, size, "cannot set the receive buffer");
  }
  // The socket binds the group's address, because other groups on this port are other buses.
  const sockaddr_in address = address_of(url);
  if (::bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    fail_with_errno(url, "cannot bind the port");
  }
  ip_mreq membership{};
  membership.imr_multiaddr = address.sin_addr;
  membership.imr_interface.s_addr = htonl(INADDR_ANY);
  set(url, fd.get(), IPPROTO_IP, IP_ADD_MEMBERSHIP, membership, "cannot join the group");
  set(url, fd.get(), IPPROTO_IP, IP_MULTICAST_ALL, 0, "cannot leave other groups");
  return fd;
}

base::FileDescriptor open_sender(const LcmUrl& url) {
  base::FileDescriptor fd = open_socket(url);
  set(url, fd.get(), IPPROTO_IP, IP_MULTICAST_TTL, url.ttl, "cannot set the ttl");
  set(url, fd.get(), IPPROTO_IP, IP_MULTICAST_LOOP, 1, "cannot reach this host");
  const sockaddr_in address = address_of(url);
  if (::connect(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    fail_with_errno(url, "cannot send to the group");
  }
  return fd;
}

void install_filter(const LcmUrl& url, int fd, const std::vector<std::string>& channels) {
  std::vector<sock_filter> program = channel_filter(channels);
  const sock_fprog handle{static_cast<unsigned short>(program.size()), program.data()};
  set(url, fd, SOL_SOCKET, SO_ATTACH_FILTER, handle, "cannot install the channel filter");
}

std::vector<sock_filter> channel_filter(std::vector<std::string> channels) {
  // A load beyond the datagram's end rejects at once. The shortest name comes first: a datagram too
  // short for one name is too short for all later names.
  std::ranges::sort(channels, {}, [](const std::string& name) { return name.size(); });
  std::vector<sock_filter> program = {
      {load_word, 0, 0, udp_header},
      {jump_equal, 0, 2, lcm_packet::short_magic},
      {load_index, 0, 0, udp_header + lcm_packet::header_size},
      {jump, 0, 0, 6},  // to the names
      {jump_equal, 1, 0, lcm_packet::fragment_magic},
      {give_back, 0, 0, reject},
      {load_half, 0, 0, udp_header + lcm_packet::fragment_number_offset},
      {jump_equal, 1, 0, 0},
      {give_back, 0, 0, reject},
      {load_index, 0, 0, udp_header + lcm_packet::fragment_header_size},
  };
  for (const std::string& channel : channels) add_name(channel, program);
  program.push_back({give_back, 0, 0, reject});
  if (program.size() > BPF_MAXINSNS) {
    throw std::invalid_argument(fmt::format(
        "too many channels for one socket filter: {}; use subscribe_all", channels.size()));
  }
  return program;
}

}  // namespace tachless::bus

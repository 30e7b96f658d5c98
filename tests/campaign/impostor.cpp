#include "tests/campaign/impostor.h"

#include <arpa/inet.h>
#include <netinet/ip.h>
#include <netinet/udp.h>
#include <sys/socket.h>

#include <cerrno>
#include <charconv>
#include <cstring>
#include <span>
#include <system_error>
#include <vector>

#include "bus/authenticated.h"
#include "bus/lcm_packet.h"
#include "session/options.h"

namespace tachless::campaign {
namespace {

// Sequence numbers that mark the impostor's own datagrams; no other sender reaches them.
constexpr std::uint32_t first_own = 0x80000000;

base::FileDescriptor raw_socket() {
  base::FileDescriptor fd(socket(AF_INET, SOCK_RAW | SOCK_CLOEXEC, IPPROTO_RAW));
  if (fd.get() < 0) throw std::system_error(errno, std::generic_category(), "raw socket");
  return fd;
}

/// @param sender "localhost:41234"
std::uint16_t port_of(std::string_view sender) {
  std::uint16_t port = 0;
  std::from_chars(sender.data() + sender.rfind(':') + 1, sender.data() + sender.size(), port);
  return port;
}

template <class Header>
void append(std::vector<std::byte>& bytes, const Header& header) {
  const auto from = std::as_bytes(std::span(&header, 1));
  bytes.insert(bytes.end(), from.begin(), from.end());
}

}  // namespace

Impostor::Impostor(std::string_view whom) : bus_(bus::LcmUrl()), sequence_(first_own) {
  for (int i = 0; i < messages::num_roles; ++i) {
    const auto role = static_cast<messages::Role>(i);
    if (whom == std::string(messages::name(role)) + "'s endpoint") whom_ = role;
  }
  if (whom_) raw_ = raw_socket();
}

void Impostor::look_for_member(const bus::Datagram& datagram) {
  if (!whom_ || port_ != 0 || !datagram.channel.ends_with("_PARTICIPANT")) return;
  messages::Stamp stamp;
  messages::Participant who;
  auto payload = datagram.payload;
  if (codec_.decode(payload, stamp, who) != messages::Rejection::none) {
    if (payload.size() <= bus::tag_size) return;
    payload = payload.first(payload.size() - bus::tag_size);
    if (codec_.decode(payload, stamp, who) != messages::Rejection::none) return;
  }
  if (who.role == *whom_) port_ = port_of(datagram.sender);
}

std::optional<bus::Datagram> Impostor::receive(base::Clock::time_point deadline) {
  while (const auto datagram = bus_.receive(deadline)) {
    if (datagram->sequence >= first_own) continue;
    look_for_member(*datagram);
    return datagram;
  }
  return std::nullopt;
}

void Impostor::publish(std::string_view channel, std::span<const std::byte> payload) {
  if (port_ == 0) return bus_.publish(channel, payload);
  const bus::LcmUrl& url = bus_.url();
  const auto size = static_cast<std::uint16_t>(sizeof(udphdr) + bus::lcm_packet::header_size +
                                               channel.size() + 1 + payload.size());
  sockaddr_in to{};
  to.sin_family = AF_INET;
  inet_pton(AF_INET, url.group.c_str(), &to.sin_addr);
  iphdr ip{};  // the kernel adds length, identity, checksum, and the address, which is the same for
               // all here
  ip.version = 4;
  ip.ihl = sizeof ip / 4;
  ip.ttl = 1;
  ip.protocol = IPPROTO_UDP;
  ip.daddr = to.sin_addr.s_addr;
  udphdr udp{};  // without a checksum, which IPv4 permits
  udp.source = htons(port_);
  udp.dest = htons(url.port);
  udp.len = htons(size);
  std::vector<std::byte> packet;
  append(packet, ip);
  append(packet, udp);
  append(packet, htonl(bus::lcm_packet::short_magic));
  append(packet, htonl(sequence_++));
  const auto name = std::as_bytes(std::span(channel));
  packet.insert(packet.end(), name.begin(), name.end());
  packet.push_back(std::byte{0});
  packet.insert(packet.end(), payload.begin(), payload.end());
  if (sendto(raw_.get(), packet.data(), packet.size(), 0, reinterpret_cast<const sockaddr*>(&to),
             sizeof to) < 0) {
    throw std::system_error(errno, std::generic_category(), "sending from another's address");
  }
}

}  // namespace tachless::campaign

#include "tests/soak/hostile_traffic.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <limits>
#include <stdexcept>
#include <system_error>

#include "bus/lcm_packet.h"

namespace tachless::soak {
namespace {

constexpr std::size_t run_at = 16, tick_at = 24, body_at = 32;
constexpr std::size_t samples_at_most = 256;  // of each channel
constexpr std::int64_t never_kept = 200;      // older than what any process keeps

void put(std::vector<std::byte>& bytes, std::size_t at, std::uint64_t value, std::size_t size) {
  for (std::size_t i = 0; i < size; ++i) {
    bytes.at(at + i) = static_cast<std::byte>(value >> (8 * (size - 1 - i)));
  }
}

bool ends(const std::string& channel, std::string_view suffix) { return channel.ends_with(suffix); }

/// Where the message has its first number or, `-1`, its last.
std::size_t number_at(const std::string& channel, std::size_t size) {
  if (ends(channel, "_TRUTH") || ends(channel, "_RUN_INFO")) return body_at + 8;
  if (ends(channel, "_PARTICIPANT")) return body_at + 22;
  return size - 8;
}

process::FileDescriptor multicast_socket() {
  process::FileDescriptor fd(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(HostileTraffic::port);
  inet_pton(AF_INET, "239.255.76.67", &to.sin_addr);
  const unsigned char ttl = 0;
  if (fd.get() < 0 || setsockopt(fd.get(), IPPROTO_IP, IP_MULTICAST_TTL, &ttl, sizeof ttl) != 0 ||
      connect(fd.get(), reinterpret_cast<const sockaddr*>(&to), sizeof to) != 0) {
    throw std::system_error(errno, std::generic_category(), "multicast socket");
  }
  return fd;
}

}  // namespace

HostileTraffic::HostileTraffic(std::int64_t run, std::uint64_t seed)
    : run_(run), random_(seed), socket_(multicast_socket()) {
  sockaddr_in own{};
  socklen_t size = sizeof own;
  if (getsockname(socket_.get(), reinterpret_cast<sockaddr*>(&own), &size) != 0) {
    throw std::system_error(errno, std::generic_category(), "getsockname");
  }
  port_text_ = ":" + std::to_string(ntohs(own.sin_port));
}

void HostileTraffic::add_sample(std::string_view channel, std::span<const std::byte> payload) {
  auto found = samples_.find(channel);
  if (found == samples_.end()) {
    found = samples_.emplace(channel, std::deque<Bytes>()).first;
    channels_.emplace_back(channel);
  }
  std::deque<Bytes>& messages = found->second;
  messages.emplace_back(payload.begin(), payload.end());
  if (messages.size() > samples_at_most) messages.pop_front();
}

const std::string& HostileTraffic::any_channel() {
  return channels_.at(static_cast<std::size_t>(any(0, std::ssize(channels_) - 1)));
}

const HostileTraffic::Bytes& HostileTraffic::any_sample(const std::string& channel) {
  const std::deque<Bytes>& messages = samples_.at(channel);
  return messages.at(static_cast<std::size_t>(any(0, std::ssize(messages) - 1)));
}

void HostileTraffic::send_datagram(std::span<const std::byte> bytes) {
  while (::send(socket_.get(), bytes.data(), bytes.size(), 0) < 0) {
    if (errno != ENOBUFS && errno != EINTR) {
      throw std::system_error(errno, std::generic_category(), "send");
    }
  }
  ++sent_;
}

void HostileTraffic::send_as_lcm(std::string_view channel, std::span<const std::byte> payload) {
  datagram_.resize(bus::lcm_packet::header_size);
  put(datagram_, 0, bus::lcm_packet::short_magic, 4);
  put(datagram_, 4, static_cast<std::uint64_t>(any(0, 0xffff'ffff)), 4);
  for (const char c : channel) datagram_.push_back(static_cast<std::byte>(c));
  datagram_.push_back(std::byte{0});
  datagram_.insert(datagram_.end(), payload.begin(), payload.end());
  send_datagram(datagram_);
}

void HostileTraffic::send_not_lcm() {
  // Any length, the longest that UDP takes included; a channel that never ends; fragments.
  const bool longest = any(0, 499) == 0;
  datagram_.resize(static_cast<std::size_t>(longest ? 65'507 : any(0, 96)));
  for (std::byte& byte : datagram_) byte = static_cast<std::byte>(any(1, 255));
  const bool fragment = any(0, 1) == 0;
  if (datagram_.size() >= 4 && any(0, 3) != 0) {
    put(datagram_, 0, fragment ? bus::lcm_packet::fragment_magic : bus::lcm_packet::short_magic, 4);
  }
  send_datagram(datagram_);
}

HostileTraffic::Bytes HostileTraffic::mutate(Kind kind, std::string& channel) {
  const auto of = [&](std::initializer_list<std::string_view> suffixes) {
    do {
      channel = any_channel();
    } while (std::ranges::none_of(suffixes, [&](auto suffix) { return ends(channel, suffix); }));
    return any_sample(channel);
  };
  Bytes bytes = any_sample(channel);
  switch (kind) {
    case Kind::random_bytes:
      bytes.resize(static_cast<std::size_t>(any(0, 300)));
      for (std::byte& byte : bytes) byte = static_cast<std::byte>(any(0, 255));
      return bytes;
    case Kind::truncated:
      bytes.resize(static_cast<std::size_t>(any(0, std::ssize(bytes) - 1)));
      return bytes;
    case Kind::lengthened:
      bytes.resize(
          std::min(bytes.size() + static_cast<std::size_t>(any(1, any(0, 99) == 0 ? 60'000 : 64)),
                   bus::lcm_packet::max_short_size - channel.size() - 1),
          std::byte{0});
      return bytes;
    case Kind::wrong_type:
      bytes[static_cast<std::size_t>(any(0, 7))] ^= static_cast<std::byte>(any(1, 255));
      return bytes;
    case Kind::wrong_count: {
      bytes = of({"_COMMAND", "_POSITION", "_REFERENCE", "_CONTROLLER_STATE", "_TRUTH"});
      constexpr std::array<std::uint32_t, 6> counts = {0,           65,          0x7fff'ffff,
                                                       0x8000'0000, 0x2000'0000, 0xffff'ffff};
      put(bytes, body_at, counts[static_cast<std::size_t>(any(0, 5))], 4);
      return bytes;
    }
    case Kind::non_finite: {
      bytes = of({"_COMMAND", "_POSITION", "_REFERENCE", "_CONTROLLER_STATE", "_TRUTH",
                  "_PARTICIPANT", "_RUN_INFO"});
      constexpr std::array<std::uint64_t, 4> values = {0x7ff0'0000'0000'0000, 0xfff0'0000'0000'0000,
                                                       0x7ff8'0000'0000'0000,
                                                       0x7ff0'0000'0000'0001};
      put(bytes, number_at(channel, bytes.size()), values[static_cast<std::size_t>(any(0, 3))], 8);
      return bytes;
    }
    case Kind::bad_value:
      bytes = of({"_TICK", "_PARTICIPANT"});
      bytes.at(ends(channel, "_TICK") ? body_at : body_at + 20) =
          static_cast<std::byte>(any(9, 99));
      return bytes;
    case Kind::bad_text:
      bytes = of({"_PARTICIPANT", "_RUN_INFO"});
      put(bytes, ends(channel, "_RUN_INFO") ? body_at + 16 : body_at + 30,
          static_cast<std::uint64_t>(any(1'000'000, 0xffff'ffff)), 4);
      return bytes;
    case Kind::other_run:
      put(bytes, run_at, static_cast<std::uint64_t>(run_ + any(1, 1'000'000)), 8);
      if (ends(channel, "_PARTICIPANT")) {
        put(bytes, body_at, static_cast<std::uint64_t>(any(1, 1'000'000)), 8);  // instance
        bytes.at(body_at + 20) = static_cast<std::byte>(any(0, 4));             // state
        if (any(0, 1) == 0) put(bytes, body_at + 8, std::uint64_t{0x5eed}, 8);  // digest
      } else {
        put(bytes, tick_at, static_cast<std::uint64_t>(tick_ + any(-2, 2)), 8);
      }
      return bytes;
    case Kind::stale:
      bytes = of({"_TICK", "_COMMAND", "_POSITION", "_REFERENCE", "_CONTROLLER_STATE", "_TRUTH",
                  "_LOG_ACK"});
      put(bytes, tick_at, static_cast<std::uint64_t>(tick_ - never_kept - any(0, 5'000)), 8);
      return bytes;
    case Kind::future:
      bytes = of({"_TICK", "_COMMAND", "_POSITION", "_REFERENCE", "_CONTROLLER_STATE", "_TRUTH",
                  "_LOG_ACK", "_RUN_INFO"});
      put(bytes, tick_at,
          any(0, 9) == 0 ? std::numeric_limits<std::int64_t>::max() - any(0, 2)
                         : static_cast<std::uint64_t>(any(1'000'000'000, 2'000'000'000)),
          8);
      return bytes;
    case Kind::replayed:
      return bytes;
    case Kind::not_lcm:
      break;
  }
  throw std::logic_error("no such kind of datagram");
}

void HostileTraffic::send(std::int64_t longest) {
  for (std::int64_t left = any(1, longest); left > 0; --left) send_one();
}

void HostileTraffic::send_one() {
  const auto kind = static_cast<Kind>(any(0, static_cast<int>(Kind::last)));
  if (kind == Kind::not_lcm) return send_not_lcm();
  std::string channel = any_channel();
  const Bytes bytes = mutate(kind, channel);
  send_as_lcm(channel, bytes);
}

}  // namespace tachless::soak

#include "bus/udp_transport.h"

#include <arpa/inet.h>
#include <fmt/core.h>
#include <linux/sock_diag.h>
#include <poll.h>
#include <signal.h>
#include <sys/uio.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <stdexcept>

#include "bus/lcm_packet.h"
#include "bus/socket.h"

namespace tachless::bus {
namespace {

constexpr std::size_t max_datagram = 65'536;

void require_channel(std::string_view channel) {
  if (channel.empty() || channel.size() > lcm_packet::max_channel_size ||
      channel.find('\0') != std::string_view::npos) {
    throw std::invalid_argument(
        fmt::format("channel name '{}' has {} characters, allowed are 1 to 63 without NUL", channel,
                    channel.size()));
  }
}

bool same(const sockaddr_in& a, const sockaddr_in& b) {
  return a.sin_port == b.sin_port && a.sin_addr.s_addr == b.sin_addr.s_addr;
}

}  // namespace

UdpTransport::UdpTransport(const LcmUrl& url)
    : url_(url),
      receiver_(open_receiver(url)),
      sender_(open_sender(url)),
      buffer_(batch * max_datagram) {
  socklen_t size = sizeof own_address_;
  if (::getsockname(sender_.get(), reinterpret_cast<sockaddr*>(&own_address_), &size) != 0) {
    fail_with_errno(url_, "cannot read the own address");
  }
}

int UdpTransport::subscribe(const std::string& channel) {
  require_channel(channel);
  const std::size_t before = channels_.all().size();
  const int number = channels_.add(channel);
  if (!all_ && channels_.all().size() > before) {
    install_filter(url_, receiver_.get(), channels_.all());
  }
  return number;
}

void UdpTransport::subscribe_all() {
  if (all_) return;
  set(url_, receiver_.get(), SOL_SOCKET, SO_TIMESTAMPNS, 1, "cannot have datagrams stamped");
  set(url_, receiver_.get(), SOL_SOCKET, SO_DETACH_FILTER, 0, "cannot remove the channel filter");
  drops_before_ = socket_drops();
  all_ = true;
}

void UdpTransport::publish(std::string_view channel, std::span<const std::byte> payload) {
  require_channel(channel);
  const std::size_t size = channel.size() + 1 + payload.size();
  if (size > lcm_packet::max_short_size) {
    throw std::length_error(fmt::format("message on {} needs {} bytes, one datagram holds {}",
                                        channel, size, lcm_packet::max_short_size));
  }
  std::array<std::uint32_t, 2> header = {htonl(lcm_packet::short_magic), htonl(sequence_++)};
  char nul = 0;
  // iovec has no const; sendmsg only reads.
  std::array<iovec, 4> parts = {{{header.data(), sizeof header},
                                 {const_cast<char*>(channel.data()), channel.size()},
                                 {&nul, 1},
                                 {const_cast<std::byte*>(payload.data()), payload.size()}}};
  msghdr message{};
  message.msg_iov = parts.data();
  message.msg_iovlen = parts.size();
  if (::sendmsg(sender_.get(), &message, MSG_DONTWAIT | MSG_NOSIGNAL) < 0) {
    ++statistics_.unsent;
    statistics_.refusal = errno;
  }
}

int UdpTransport::wait(base::Clock::time_point deadline, bool for_datagram) {
  pollfd descriptor{receiver_.get(), POLLIN, 0};
  const int ready = poll_until({&descriptor, for_datagram ? 1U : 0U}, deadline);
  if (ready < 0 && errno != EINTR) fail_with_errno(url_, "cannot wait");
  return ready;
}

/// Reads the datagrams that wait in the socket, at most `batch`.
/// @return whether there was a datagram
bool UdpTransport::read_batch() {
  for (int i = 0; i < batch; ++i) {
    Held& held = held_[i];
    held.part = {buffer_.data() + i * max_datagram, max_datagram};
    msghdr& header = headers_[i].msg_hdr;
    header = {};
    header.msg_name = &held.from;
    header.msg_namelen = sizeof held.from;
    header.msg_iov = &held.part;
    header.msg_iovlen = 1;
    if (all_) {
      header.msg_control = held.control.data();
      header.msg_controllen = held.control.size();
    }
  }
  next_held_ = 0;
  num_held_ = ::recvmmsg(receiver_.get(), headers_.data(), batch, MSG_DONTWAIT, nullptr);
  if (num_held_ < 0) {
    num_held_ = 0;
    if (errno != EAGAIN) fail_with_errno(url_, "cannot receive");
  }
  return num_held_ > 0;
}

/// Reads the datagrams in the socket, or waits for some until the deadline.
/// @return false if no datagram came or a signal ended the wait
bool UdpTransport::fetch(base::Clock::time_point deadline, bool passed_over) {
  // The caller's deadline also holds in a flood of ignored messages.
  if (passed_over && base::Clock::now() >= deadline) return false;
  const bool more_may_wait = num_held_ == batch;
  if (more_may_wait && read_batch()) return true;
  if (pause_.count() > 0) {
    const auto now = base::Clock::now();
    if (now < deadline && wait(std::min(deadline, now + pause_), false) < 0) return false;
  }
  while (wait(deadline, true) > 0) {
    if (read_batch()) return true;
  }
  return false;
}

std::optional<Datagram> UdpTransport::receive(base::Clock::time_point deadline) {
  for (bool passed_over = false;; passed_over = true) {
    if (next_held_ == num_held_ && !fetch(deadline, passed_over)) return std::nullopt;
    msghdr& header = headers_[next_held_].msg_hdr;
    const std::size_t size = headers_[next_held_].msg_len;
    const Held& held = held_[next_held_++];
    const std::span bytes(static_cast<const std::byte*>(held.part.iov_base), size);
    std::optional<Datagram> datagram = parse(bytes, held.from);
    if (!datagram) continue;
    for (cmsghdr* c = CMSG_FIRSTHDR(&header); c != nullptr; c = CMSG_NXTHDR(&header, c)) {
      if (c->cmsg_level != SOL_SOCKET || c->cmsg_type != SCM_TIMESTAMPNS) continue;
      timespec stamp{};
      std::memcpy(&stamp, CMSG_DATA(c), sizeof stamp);
      datagram->received_ns = std::int64_t{stamp.tv_sec} * 1'000'000'000 + stamp.tv_nsec;
    }
    ++statistics_.received;
    return datagram;
  }
}

std::optional<Datagram> UdpTransport::parse(std::span<const std::byte> bytes,
                                            const sockaddr_in& from) {
  const auto passed_over = [](std::uint64_t& count) -> std::optional<Datagram> {
    ++count;
    return std::nullopt;
  };
  if (same(from, own_address_)) return passed_over(statistics_.own);
  if (bytes.size() < lcm_packet::header_size) return passed_over(statistics_.malformed);
  const std::uint32_t magic = lcm_packet::word_at(bytes.data());
  if (magic == lcm_packet::fragment_magic) {
    if (bytes.size() < lcm_packet::fragment_header_size) return passed_over(statistics_.malformed);
    // A fragmented message is counted once, at its first fragment.
    const auto number = bytes.subspan(lcm_packet::fragment_number_offset, 2);
    const bool first = number[0] == std::byte{0} && number[1] == std::byte{0};
    return first ? passed_over(statistics_.fragmented) : std::nullopt;
  }
  const auto text = bytes.subspan(lcm_packet::header_size);
  const void* nul =
      std::memchr(text.data(), 0, std::min(text.size(), lcm_packet::max_channel_size + 1));
  if (magic != lcm_packet::short_magic || nul == nullptr || nul == text.data()) {
    return passed_over(statistics_.malformed);
  }
  const auto length = static_cast<std::size_t>(static_cast<const std::byte*>(nul) - text.data());
  const std::string_view channel(reinterpret_cast<const char*>(text.data()), length);
  // Some containers accept the kernel's filter but do not apply it.
  const int number = channels_.find(channel);
  if (!all_ && number < 0) return std::nullopt;
  return Datagram{.channel = channel,
                  .payload = text.subspan(length + 1),
                  .sender = name_of(from),
                  .sequence = lcm_packet::word_at(bytes.data() + 4),
                  .channel_number = number};
}

std::string_view UdpTransport::name_of(const sockaddr_in& from) {
  for (const Sender& sender : senders_) {
    if (sender.size != 0 && same(sender.address, from)) return {sender.text.data(), sender.size};
  }
  Sender& sender = senders_[next_sender_];
  next_sender_ = (next_sender_ + 1) % senders_.size();
  sender.address = from;
  std::array<char, INET_ADDRSTRLEN> host{"localhost"};
  // A datagram over a loopback route has no source address.
  if (from.sin_addr.s_addr != htonl(INADDR_ANY)) {
    inet_ntop(AF_INET, &from.sin_addr, host.data(), host.size());
  }
  sender.size = fmt::format_to_n(sender.text.data(), sender.text.size(), "{}:{}", host.data(),
                                 ntohs(from.sin_port))
                    .size;
  return {sender.text.data(), sender.size};
}

std::uint64_t UdpTransport::socket_drops() const {
  return get<std::array<std::uint32_t, SK_MEMINFO_VARS>>(
      url_, receiver_.get(), SO_MEMINFO, "cannot read the drop counter")[SK_MEMINFO_DROPS];
}

BusStatistics UdpTransport::statistics() const {
  BusStatistics result = statistics_;
  if (all_) result.overflowed = socket_drops() - drops_before_;
  return result;
}

int UdpTransport::receive_buffer_bytes() const {
  // The kernel doubles the requested size to have room for its own records.
  return get<int>(url_, receiver_.get(), SO_RCVBUF, "cannot read the receive buffer") / 2;
}

}  // namespace tachless::bus

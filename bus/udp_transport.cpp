#include "bus/udp_transport.h"

#include <arpa/inet.h>
#include <linux/sock_diag.h>
#include <poll.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/uio.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <system_error>

#include "bus/lcm_packet.h"
#include "bus/poll_until.h"
#include "bus/udp_socket.h"

namespace tachless::bus {
namespace {

constexpr std::size_t max_datagram = 65'536;
constexpr std::size_t kernel_overhead_bytes = 1024;  // of a datagram in the receive buffer, about

void require_channel(std::string_view channel) {
  if (channel.empty() || channel.size() > lcm_packet::max_channel_size ||
      channel.find('\0') != std::string_view::npos) {
    throw std::invalid_argument("channel name '" + std::string(channel) + "' has " +
                                std::to_string(channel.size()) +
                                " characters, allowed are 1 to 63 without NUL");
  }
}

bool same(const sockaddr_in& a, const sockaddr_in& b) {
  return a.sin_port == b.sin_port && a.sin_addr.s_addr == b.sin_addr.s_addr;
}

std::uint32_t word_at(const std::byte* bytes) {
  std::uint32_t value = 0;
  std::memcpy(&value, bytes, sizeof value);
  return ntohl(value);
}

/// UDP's RcvbufErrors in /proc/net/snmp: names in one line, numbers in the next.
std::uint64_t host_overflows() {
  std::ifstream file("/proc/net/snmp");
  std::string names;
  std::string numbers;
  while (std::getline(file, names) && std::getline(file, numbers)) {
    if (names.rfind("Udp:", 0) != 0) continue;
    std::istringstream name_stream(names);
    std::istringstream number_stream(numbers);
    std::string name;
    std::string number;
    while (name_stream >> name && number_stream >> number) {
      if (name == "RcvbufErrors") return std::stoull(number);
    }
  }
  return 0;
}

const LcmUrl& require_udp(const LcmUrl& url) {
  if (url.is_tcp()) throw std::invalid_argument(url.text() + ": needed here is a bus over UDP");
  return url;
}

}  // namespace

UdpTransport::UdpTransport(const std::string& url) : UdpTransport(parse_lcm_url(url)) {}

UdpTransport::UdpTransport(const LcmUrl& url)
    : url_(require_udp(url)),
      receiver_(open_receiver(url)),
      sender_(open_sender(url)),
      buffer_(batch * max_datagram),
      host_overflowed_before_(host_overflows()) {
  socklen_t size = sizeof own_address_;
  if (::getsockname(sender_.get(), reinterpret_cast<sockaddr*>(&own_address_), &size) != 0) {
    fail_with_errno(url_, "cannot read the own address");
  }
}

void UdpTransport::subscribe(const std::string& channel) {
  require_channel(channel);
  if (std::find(channels_.begin(), channels_.end(), channel) != channels_.end()) return;
  channels_.push_back(channel);
  if (!all_) install_filter(url_, receiver_.get(), channels_);
}

void UdpTransport::subscribe_all() {
  if (all_) return;
  stamp_arrivals();
  set(url_, receiver_.get(), SOL_SOCKET, SO_DETACH_FILTER, 0, "cannot remove the channel filter");
  drops_before_ = socket_drops();
  all_ = true;
}

void UdpTransport::stamp_arrivals() {
  set(url_, receiver_.get(), SOL_SOCKET, SO_TIMESTAMPNS, 1, "cannot have datagrams stamped");
  stamped_ = true;
}

void UdpTransport::publish(std::string_view channel, std::span<const std::byte> payload) {
  require_channel(channel);
  const std::size_t size = channel.size() + 1 + payload.size();
  if (size > lcm_packet::max_short_size) {
    throw std::length_error("message on " + std::string(channel) + " needs " +
                            std::to_string(size) + " bytes, one datagram holds " +
                            std::to_string(lcm_packet::max_short_size));
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

std::optional<Datagram> UdpTransport::receive(loop::Clock::time_point deadline) {
  const std::optional<RawDatagram> raw = next(deadline);
  if (!raw) return std::nullopt;
  return raw->datagram;
}

std::optional<RawDatagram> UdpTransport::receive_raw(loop::Clock::time_point deadline) {
  if (!stamped_) throw std::logic_error("bus::UdpTransport: receive_raw needs stamp_arrivals");
  return next(deadline);
}

UdpTransport::Wake UdpTransport::wait(loop::Clock::time_point deadline, bool for_datagram) {
  pollfd descriptor{receiver_.get(), POLLIN, 0};
  const int ready = poll_until({&descriptor, for_datagram ? 1U : 0U}, deadline);
  if (ready < 0 && errno != EINTR) fail_with_errno(url_, "cannot wait");
  if (ready < 0) return Wake::signal;
  return ready > 0 ? Wake::datagram : Wake::deadline;
}

void UdpTransport::collect(int messages, std::chrono::nanoseconds longest) {
  // A part: what comes while the collected is read needs room, too.
  const auto room = static_cast<std::size_t>(receive_buffer_bytes()) / 2;
  nap_ = Nap{messages, room, longest, longest / 16};
}

UdpTransport::Wake UdpTransport::nap(loop::Clock::time_point deadline) {
  const double fullness = std::max(static_cast<double>(nap_->come) / nap_->messages,
                                   static_cast<double>(nap_->occupied) / nap_->room);
  const auto wanted =
      std::chrono::duration_cast<std::chrono::nanoseconds>(nap_->length / std::max(fullness, 0.5));
  nap_->length = std::min(wanted, nap_->longest);
  nap_->come = 0;
  nap_->occupied = 0;
  return wait(std::min(deadline, loop::Clock::now() + nap_->length), false);
}

/// Whether there was something to read.
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
    if (stamped_) {
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

/// Reads what waits in the socket, or what comes before the deadline.
/// @return false if nothing came, or a signal
bool UdpTransport::fetch(loop::Clock::time_point deadline, bool passed_over) {
  // A flood of what is passed over must not keep the caller from its deadline.
  if (passed_over && loop::Clock::now() >= deadline) return false;
  const bool more_may_wait = num_held_ == batch;
  if (more_may_wait && read_batch()) return true;
  if (nap_ && deadline > loop::Clock::now()) {
    if (nap(deadline) == Wake::signal) return false;
    if (read_batch()) return true;
  }
  while (spin_ && loop::Clock::now() < deadline) {
    if (read_batch()) return true;
  }
  while (wait(deadline, true) == Wake::datagram) {
    if (read_batch()) return true;
  }
  return false;
}

std::optional<RawDatagram> UdpTransport::next(loop::Clock::time_point deadline) {
  for (bool passed_over = false;; passed_over = true) {
    if (!holds_datagrams() && !fetch(deadline, passed_over)) return std::nullopt;
    msghdr& header = headers_[next_held_].msg_hdr;
    const std::size_t size = headers_[next_held_].msg_len;
    const Held& held = held_[next_held_++];
    if (nap_) {
      ++nap_->come;
      nap_->occupied += size + kernel_overhead_bytes;
    }
    const std::span bytes(static_cast<const std::byte*>(held.part.iov_base), size);
    std::optional<RawDatagram> raw = parse(bytes, held.from);
    if (!raw) continue;
    for (cmsghdr* c = CMSG_FIRSTHDR(&header); c != nullptr; c = CMSG_NXTHDR(&header, c)) {
      if (c->cmsg_level != SOL_SOCKET || c->cmsg_type != SCM_TIMESTAMPNS) continue;
      timespec stamp{};
      std::memcpy(&stamp, CMSG_DATA(c), sizeof stamp);
      raw->received_ns = std::int64_t{stamp.tv_sec} * 1'000'000'000 + stamp.tv_nsec;
    }
    ++statistics_.received;
    return raw;
  }
}

std::optional<RawDatagram> UdpTransport::parse(std::span<const std::byte> bytes,
                                               const sockaddr_in& from) {
  if (same(from, own_address_)) {
    ++statistics_.own;
    return std::nullopt;
  }
  if (bytes.size() < lcm_packet::header_size) {
    ++statistics_.malformed;
    return std::nullopt;
  }
  const std::uint32_t magic = word_at(bytes.data());
  if (magic == lcm_packet::fragment_magic) {
    // Counted once per message, by its first fragment.
    if (bytes.size() < lcm_packet::fragment_header_size) {
      ++statistics_.malformed;
    } else if (bytes[lcm_packet::fragment_number_offset] == std::byte{0} &&
               bytes[lcm_packet::fragment_number_offset + 1] == std::byte{0}) {
      ++statistics_.fragmented;
    }
    return std::nullopt;
  }
  const auto text = bytes.subspan(lcm_packet::header_size);
  const void* nul =
      std::memchr(text.data(), 0, std::min(text.size(), lcm_packet::max_channel_size + 1));
  if (magic != lcm_packet::short_magic || nul == nullptr || nul == text.data()) {
    ++statistics_.malformed;
    return std::nullopt;
  }
  const auto length = static_cast<std::size_t>(static_cast<const std::byte*>(nul) - text.data());
  RawDatagram raw;
  raw.datagram.channel = {reinterpret_cast<const char*>(text.data()), length};
  // The kernel has filtered; where it cannot (some containers accept a filter and ignore it), we
  // do.
  if (!all_ &&
      std::find(channels_.begin(), channels_.end(), raw.datagram.channel) == channels_.end()) {
    return std::nullopt;
  }
  raw.datagram.payload = text.subspan(length + 1);
  raw.datagram.sender = name_of(from);
  raw.sequence = word_at(bytes.data() + 4);
  return raw;
}

std::string_view UdpTransport::name_of(const sockaddr_in& from) {
  for (const Sender& sender : senders_) {
    if (sender.size != 0 && same(sender.address, from)) return {sender.text.data(), sender.size};
  }
  Sender& sender = senders_[next_sender_];
  next_sender_ = (next_sender_ + 1) % senders_.size();
  sender.address = from;
  if (from.sin_addr.s_addr == htonl(INADDR_ANY)) {
    // What comes over a loopback route has no source address.
    std::strcpy(sender.text.data(), "localhost");
  } else {
    inet_ntop(AF_INET, &from.sin_addr, sender.text.data(), sender.text.size());
  }
  char* const colon = sender.text.data() + std::strlen(sender.text.data());
  *colon = ':';
  char* const end = sender.text.data() + sender.text.size();
  const char* const last = std::to_chars(colon + 1, end, ntohs(from.sin_port)).ptr;
  sender.size = static_cast<std::size_t>(last - sender.text.data());
  return {sender.text.data(), sender.size};
}

std::uint64_t UdpTransport::socket_drops() const {
  std::array<std::uint32_t, SK_MEMINFO_VARS> values{};
  socklen_t size = sizeof values;
  if (::getsockopt(receiver_.get(), SOL_SOCKET, SO_MEMINFO, values.data(), &size) != 0) {
    fail_with_errno(url_, "cannot read the drop counter");
  }
  return values[SK_MEMINFO_DROPS];
}

BusStatistics UdpTransport::statistics() const {
  BusStatistics result = statistics_;
  if (all_) result.overflowed = socket_drops() - drops_before_;
  result.host_overflowed = host_overflows() - host_overflowed_before_;
  return result;
}

int UdpTransport::receive_buffer_bytes() const {
  int size = 0;
  socklen_t length = sizeof size;
  if (::getsockopt(receiver_.get(), SOL_SOCKET, SO_RCVBUF, &size, &length) != 0) {
    fail_with_errno(url_, "cannot read the receive buffer");
  }
  return size / 2;  // the kernel doubles what is asked for, to have room for its own records
}

}  // namespace tachless::bus

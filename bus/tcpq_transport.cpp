#include "bus/tcpq_transport.h"

#include <arpa/inet.h>
#include <fmt/core.h>
#include <netdb.h>
#include <netinet/tcp.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <memory>
#include <stdexcept>
#include <system_error>

#include "bus/lcm_packet.h"
#include "bus/socket.h"
#include "bus/udp_transport.h"
#include "diagnostics/failure.h"

namespace tachless::bus {
namespace {

using diagnostics::ExitCode;
using diagnostics::Failure;

// Words of the protocol, in network order on the wire; see lcm/lcm_tcpq.c of LCM.
constexpr std::uint32_t magic_server = 0x287617fa, magic_client = 0x287617fb, version = 0x0100;
constexpr std::uint32_t publish_message = 1, subscribe_message = 2;

using lcm_packet::word_at;

template <class Value>
void set_if_possible(int socket, int level, int option, const Value& value) {
  setsockopt(socket, level, option, &value, sizeof value);
}

process::FileDescriptor connected(const LcmUrl& url, std::chrono::seconds patience) {
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  int error = ENXIO;
  if (getaddrinfo(url.server.c_str(), std::to_string(url.port).c_str(), &hints, &found) != 0) {
    found = nullptr;
  }
  const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> all(found, &freeaddrinfo);
  for (const addrinfo* at = found; at != nullptr; at = at->ai_next) {
    process::FileDescriptor fd(socket(at->ai_family, at->ai_socktype | SOCK_CLOEXEC, 0));
    const timeval limit{patience.count(), 0};
    set_if_possible(fd.get(), SOL_SOCKET, SO_SNDTIMEO, limit);  // holds for connect, too
    set_if_possible(fd.get(), SOL_SOCKET, SO_RCVTIMEO, limit);
    set_if_possible(fd.get(), SOL_SOCKET, SO_KEEPALIVE, 1);
    set_if_possible(fd.get(), IPPROTO_TCP, TCP_NODELAY, 1);
    set_if_possible(fd.get(), IPPROTO_TCP, TCP_USER_TIMEOUT,
                    static_cast<unsigned>(1000 * patience.count()));
    if (fd.get() >= 0 && ::connect(fd.get(), at->ai_addr, at->ai_addrlen) == 0) return fd;
    error = errno == EINPROGRESS ? ETIMEDOUT : errno;
  }
  throw std::system_error(error, std::generic_category(),
                          fmt::format("{}: no LCM server", url.text()));
}

}  // namespace

std::unique_ptr<MonitoredBus> open_bus(const LcmUrl& url) {
  if (url.is_tcp()) return std::make_unique<TcpqTransport>(url);
  return std::make_unique<UdpTransport>(url);
}

std::string server_command(const LcmUrl& url) {
  return fmt::format("java -cp /usr/share/java/lcm.jar lcm.lcm.TCPService {}", url.port);
}

TcpqTransport::TcpqTransport(const LcmUrl& url)
    : name_(url.text()), socket_(connected(url, patience)), buffer_(4 * longest_message) {
  const std::array<std::uint32_t, 2> hello = {htonl(magic_client), htonl(version)};
  std::array<std::byte, sizeof hello> answer{};
  if (::send(socket_.get(), hello.data(), sizeof hello, MSG_NOSIGNAL) != sizeof hello ||
      ::recv(socket_.get(), answer.data(), answer.size(), MSG_WAITALL) != sizeof hello ||
      word_at(answer.data()) != magic_server) {
    throw std::system_error(EPROTO, std::generic_category(),
                            name_ + ": who answers there is no LCM server");
  }
}

void TcpqTransport::lose(const std::string& why) const {
  throw Failure(ExitCode::peer_lost,
                "{}: the connection to the LCM server is gone: {}; start it again, and a new run",
                name_, why);
}

void TcpqTransport::subscribe(const std::string& channel) {
  const bool plain = std::ranges::all_of(channel, [](char c) {
    return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_';
  });
  if (channel.empty() || channel.size() > longest_channel || !plain) {
    throw std::invalid_argument(
        fmt::format("channel \"{}\": allowed over tcpq: 1 to 63 letters, digits and _", channel));
  }
  channels_.push_back(channel);
  send(subscribe_message, channel, nullptr);
}

void TcpqTransport::subscribe_all() {
  all_ = true;
  send(subscribe_message, ".*", nullptr);
}

void TcpqTransport::publish(std::string_view channel, std::span<const std::byte> payload) {
  if (channel.size() + payload.size() > longest_message) {
    throw std::length_error(fmt::format("{} bytes on channel {}; allowed: {}", payload.size(),
                                        channel, longest_message - channel.size()));
  }
  if (all_ || std::ranges::find(channels_, channel) != channels_.end()) {
    sent_.push_back({std::string(channel), {payload.begin(), payload.end()}});
    if (sent_.size() > most_sent) {
      throw Failure(ExitCode::protocol_violated,
                    "{}: the server does not send back what it is sent: {} messages on channel {} "
                    "are missing",
                    name_, sent_.size(), channel);
    }
  }
  send(publish_message, channel, &payload);
}

void TcpqTransport::send(std::uint32_t type, std::string_view channel,
                         const std::span<const std::byte>* payload) {
  out_.clear();
  const auto add = [&](const void* data, std::size_t size) {
    const auto* bytes = static_cast<const std::byte*>(data);
    out_.insert(out_.end(), bytes, bytes + size);
  };
  const auto add_number = [&](std::size_t number) {
    const std::uint32_t word = htonl(static_cast<std::uint32_t>(number));
    add(&word, sizeof word);
  };
  add_number(type);
  add_number(channel.size());
  add(channel.data(), channel.size());
  if (payload != nullptr) {
    add_number(payload->size());
    add(payload->data(), payload->size());
  }
  for (std::span<const std::byte> left(out_); !left.empty();) {
    const ssize_t sent = ::send(socket_.get(), left.data(), left.size(), MSG_NOSIGNAL);
    if (sent < 0 && errno == EINTR) continue;
    if (sent < 0) lose(errno == EAGAIN ? "it takes nothing any more" : std::strerror(errno));
    left = left.subspan(static_cast<std::size_t>(sent));
  }
}

bool TcpqTransport::read(loop::Clock::time_point deadline) {
  std::array<pollfd, 1> fds{pollfd{socket_.get(), POLLIN, 0}};
  if (poll_until(fds, deadline) <= 0) return false;
  // The server writes a message in pieces, each of which waits for the last one's acknowledgement.
  set_if_possible(socket_.get(), IPPROTO_TCP, TCP_QUICKACK, 1);
  if (begin_ > 0) {
    std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
    end_ -= begin_;
    begin_ = 0;
  }
  const ssize_t got =
      ::recv(socket_.get(), buffer_.data() + end_, buffer_.size() - end_, MSG_DONTWAIT);
  if (got == 0) lose("the server has closed it");
  if (got < 0 && errno != EAGAIN && errno != EINTR) lose(std::strerror(errno));
  end_ += static_cast<std::size_t>(std::max<ssize_t>(got, 0));
  return true;
}

bool TcpqTransport::parse(Datagram& message) {
  for (;;) {
    const std::size_t skipped = std::min(skip_, end_ - begin_);
    begin_ += skipped;
    skip_ -= skipped;
    const std::byte* at = buffer_.data() + begin_;
    const std::size_t have = end_ - begin_;
    if (skip_ > 0 || have < 8) return false;
    // The word before, the message's type, is not looked at: liblcm does not either.
    const std::size_t channel = word_at(at + 4);
    if (channel > longest_message) {
      throw Failure(ExitCode::protocol_violated, name_ + ": what the server sends is no LCM");
    }
    if (have < 8 + channel + 4) return false;
    const std::size_t size = word_at(at + 8 + channel);
    if (channel > longest_channel || channel + size > longest_message) {  // on no bus of UDP
      ++statistics_.malformed;
      skip_ = 12 + channel + size;
      continue;
    }
    if (have < 12 + channel + size) return false;
    message.channel = {reinterpret_cast<const char*>(at + 8), channel};
    message.payload = {at + 12 + channel, size};
    message.sender = name_;
    begin_ += 12 + channel + size;
    return true;
  }
}

bool TcpqTransport::is_own(const Datagram& message) {
  // What one program sends comes back in its order.
  if (sent_.empty()) return false;
  if (sent_.front().channel != message.channel ||
      !std::ranges::equal(sent_.front().payload, message.payload)) {
    return false;
  }
  sent_.pop_front();
  ++statistics_.own;
  return true;
}

std::optional<Datagram> TcpqTransport::receive(loop::Clock::time_point deadline) {
  Datagram message;
  for (;;) {
    while (parse(message)) {
      if (is_own(message)) continue;
      message.sequence = static_cast<std::uint32_t>(++statistics_.received);
      message.received_ns =
          std::chrono::nanoseconds(std::chrono::system_clock::now().time_since_epoch()).count();
      return message;
    }
    if (!read(deadline)) return std::nullopt;
  }
}

int TcpqTransport::receive_buffer_bytes() const {
  int bytes = 0;
  socklen_t size = sizeof bytes;
  getsockopt(socket_.get(), SOL_SOCKET, SO_RCVBUF, &bytes, &size);
  return bytes;
}

}  // namespace tachless::bus

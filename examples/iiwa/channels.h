#pragma once

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include <tachless/bus/udp_transport.h>
#include "drake/lcmt_iiwa_command.hpp"
#include "drake/lcmt_iiwa_status.hpp"

namespace tachless::iiwa {

inline constexpr const char* status_channel = "IIWA_STATUS";
inline constexpr const char* command_channel = "IIWA_COMMAND";

/// Publishes one type of message and receives another, on a socket of its own.
template <class Sent, class Heard>
class Channels {
 public:
  Channels(const bus::LcmUrl& url, std::string send_to, const char* hear)
      : transport_(url), send_to_(std::move(send_to)) {
    transport_.subscribe(hear);
  }

  void send(const Sent& message) {
    bytes_.resize(static_cast<std::size_t>(message.getEncodedSize()));
    message.encode(bytes_.data(), 0, static_cast<int>(bytes_.size()));
    transport_.publish(send_to_, bytes_);
  }

  /// Waits for a message, until `deadline`, and takes the newest that is there; whether one came.
  /// Damaged ones do not count.
  bool receive(Heard& message, loop::Clock::time_point deadline) {
    bool heard = false;
    while (const auto datagram = transport_.receive(heard ? loop::Clock::time_point() : deadline)) {
      const auto size = static_cast<int>(datagram->payload.size());
      if (message.decode(datagram->payload.data(), 0, size) == size) heard = true;
    }
    return heard;
  }

 private:
  bus::UdpTransport transport_;
  std::string send_to_;
  std::vector<std::byte> bytes_;
};

}  // namespace tachless::iiwa

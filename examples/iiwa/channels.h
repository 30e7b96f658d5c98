#pragma once

#include <cstddef>
#include <exception>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <tachless/bus/udp_transport.h>
#include "drake/lcmt_iiwa_command.hpp"
#include "drake/lcmt_iiwa_status.hpp"

namespace tachless::iiwa {

inline constexpr const char *status_channel = "IIWA_STATUS", *command_channel = "IIWA_COMMAND";

/// A socket that publishes one type of message and receives another.
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

  /// Waits until `deadline` and takes the newest message that is not damaged; false: none arrived.
  bool receive(Heard& message, base::Clock::time_point deadline) {
    bool heard = false;
    do {  // a signal ends a wait before the deadline
      while (const auto datagram =
                 transport_.receive(heard ? base::Clock::time_point() : deadline)) {
        if (!decode(datagram->payload)) continue;
        std::swap(message, next_);
        heard = true;
      }
    } while (!heard && base::Clock::now() < deadline);
    return heard;
  }

 private:
  /// Decodes the bytes into `next_`; false: they are no message.
  bool decode(std::span<const std::byte> bytes) try {
    const auto size = static_cast<int>(bytes.size());
    return next_.decode(bytes.data(), 0, size) == size;
  } catch (const std::exception&) {  // the announced counts are too large to allocate
    return false;
  }

  bus::UdpTransport transport_;
  std::string send_to_;
  Heard next_{};
  std::vector<std::byte> bytes_;
};

}  // namespace tachless::iiwa

#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>

#include "base/clock.h"
#include "base/file_descriptor.h"

namespace tachless::mit_can {

/// One frame with eight bytes of data or fewer, of classical CAN or CAN-FD.
struct Frame {
  std::uint32_t id = 0;   ///< 11 or 29 bits
  bool extended = false;  ///< `id` has 29 bits
  std::uint8_t length = 8;
  std::array<std::uint8_t, 8> data{};

  friend bool operator==(const Frame&, const Frame&) = default;
};

/// A CAN bus: an interface of the kernel (SocketCAN), or, for tests and emulators, a Unix socket
/// that carries the same frames as packets.
class CanBus {
 public:
  /// Opens the bus.
  /// @param name "can0", or "unix:PATH" for a socket of type SOCK_SEQPACKET
  /// @param fd true: frames are CAN-FD frames with the fast bit rate for their data
  /// @throw base::Failure(bad_usage) naming the bus and the remedy
  CanBus(std::string name, bool fd);

  [[nodiscard]] const std::string& name() const { return name_; }

  /// Sends a frame. A full queue loses the frame.
  /// @return false if the frame was lost
  /// @throw base::Failure(protective_stop) when the bus is gone
  bool send(const Frame& frame);
  /// Returns the next frame that has arrived by the deadline; nothing if there is none. Frames that
  /// are longer than eight bytes are passed over.
  /// @throw base::Failure(protective_stop) when the bus is gone
  std::optional<Frame> receive(base::Clock::time_point deadline);

 private:
  [[nodiscard]] std::optional<Frame> receive_now();

  std::string name_;
  bool fd_;
  base::FileDescriptor socket_;
};

}  // namespace tachless::mit_can

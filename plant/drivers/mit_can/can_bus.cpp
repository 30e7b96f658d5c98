#include "plant/drivers/mit_can/can_bus.h"

#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/un.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include "base/failure.h"

namespace tachless::mit_can {
namespace {

using base::Clock;
using base::ExitCode;
using base::Failure;
using base::FileDescriptor;

constexpr std::string_view unix_prefix = "unix:";

FileDescriptor open_unix(const std::string& name) {
  sockaddr_un at{};
  at.sun_family = AF_UNIX;
  const std::string path = name.substr(unix_prefix.size());
  if (path.size() >= sizeof at.sun_path) {
    throw base::bad_usage("bus {}: the path is too long; allowed: {} bytes", name,
                          sizeof at.sun_path - 1);
  }
  path.copy(at.sun_path, path.size());
  FileDescriptor socket(::socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0));
  if (socket.get() < 0 ||
      ::connect(socket.get(), reinterpret_cast<const sockaddr*>(&at), sizeof at) != 0) {
    throw base::bad_usage("bus {}: {}; start the emulated bus first", name, std::strerror(errno));
  }
  return socket;
}

FileDescriptor open_interface(const std::string& name, bool fd) {
  FileDescriptor socket(::socket(AF_CAN, SOCK_RAW | SOCK_CLOEXEC, CAN_RAW));
  if (socket.get() < 0) {
    throw base::bad_usage(
        "SocketCAN: {}; the kernel needs the module can_raw, type: modprobe "
        "can_raw",
        std::strerror(errno));
  }
  ifreq request{};
  if (name.size() < IFNAMSIZ) name.copy(request.ifr_name, IFNAMSIZ - 1);
  if (::ioctl(socket.get(), SIOCGIFINDEX, &request) != 0) {
    throw base::bad_usage("bus {}: there is no such network interface; type: ip link show type can",
                          name);
  }
  const int index = request.ifr_ifindex;
  if (::ioctl(socket.get(), SIOCGIFFLAGS, &request) == 0 && (request.ifr_flags & IFF_UP) == 0) {
    throw base::bad_usage(
        "bus {}: the interface is down; type: ip link set {} up type can bitrate "
        "1000000{}",
        name, name, fd ? " dbitrate 5000000 fd on" : "");
  }
  const int on = 1;
  if (fd && ::setsockopt(socket.get(), SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &on, sizeof on) != 0) {
    throw base::bad_usage("bus {}: no CAN-FD ({}); set plant.driver.fd to false", name,
                          std::strerror(errno));
  }
  const can_err_mask_t errors = CAN_ERR_BUSOFF;
  ::setsockopt(socket.get(), SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors);
  sockaddr_can at{};
  at.can_family = AF_CAN;
  at.can_ifindex = index;
  if (::bind(socket.get(), reinterpret_cast<const sockaddr*>(&at), sizeof at) != 0) {
    throw base::bad_usage("bus {}: {}", name, std::strerror(errno));
  }
  return socket;
}

}  // namespace

CanBus::CanBus(std::string name, bool fd) : name_(std::move(name)), fd_(fd) {
  socket_ = name_.starts_with(unix_prefix) ? open_unix(name_) : open_interface(name_, fd);
}

bool CanBus::send(const Frame& frame) {
  // Both kinds of frame have identifier, length and data in the same places.
  canfd_frame bytes{};
  bytes.can_id = frame.id | (frame.extended ? CAN_EFF_FLAG : 0);
  bytes.len = frame.length;
  bytes.flags = fd_ ? CANFD_BRS : 0;
  std::ranges::copy(frame.data, bytes.data);
  const std::size_t size = fd_ ? CANFD_MTU : CAN_MTU;
  if (::send(socket_.get(), &bytes, size, MSG_DONTWAIT | MSG_NOSIGNAL) ==
      static_cast<ssize_t>(size)) {
    return true;
  }
  if (errno == ENOBUFS || errno == EAGAIN || errno == EINTR) return false;
  throw Failure(ExitCode::protective_stop, "the bus {} is gone: {}", name_, std::strerror(errno));
}

std::optional<Frame> CanBus::receive_now() {
  for (;;) {
    canfd_frame bytes{};
    const ssize_t size = ::recv(socket_.get(), &bytes, sizeof bytes, MSG_DONTWAIT);
    if (size < 0 && (errno == EAGAIN || errno == EINTR)) return std::nullopt;
    if (size <= 0) {
      throw Failure(ExitCode::protective_stop, "the bus {} is gone: {}", name_,
                    size == 0 ? "its other end has closed it" : std::strerror(errno));
    }
    if ((bytes.can_id & CAN_ERR_FLAG) != 0) {
      throw Failure(ExitCode::protective_stop,
                    "the bus {} is off after too many errors: see cable, termination and bit rates",
                    name_);
    }
    Frame frame;
    if ((size != CAN_MTU && size != CANFD_MTU) || bytes.len > frame.data.size()) continue;
    if ((bytes.can_id & CAN_RTR_FLAG) != 0) continue;
    frame.extended = (bytes.can_id & CAN_EFF_FLAG) != 0;
    frame.id = bytes.can_id & (frame.extended ? CAN_EFF_MASK : CAN_SFF_MASK);
    frame.length = bytes.len;
    std::copy_n(bytes.data, frame.data.size(), frame.data.begin());
    return frame;
  }
}

std::optional<Frame> CanBus::receive(Clock::time_point deadline) {
  for (;;) {
    if (auto frame = receive_now()) return frame;
    const auto left = deadline - Clock::now();
    if (left <= Clock::duration::zero()) return std::nullopt;
    const auto seconds = std::chrono::floor<std::chrono::seconds>(left);
    const timespec time{seconds.count(), std::chrono::nanoseconds(left - seconds).count()};
    pollfd ready{socket_.get(), POLLIN, 0};
    ::ppoll(&ready, 1, &time, nullptr);
  }
}

}  // namespace tachless::mit_can

#include "bus/poll_until.h"

#include <chrono>

namespace tachless::bus {

int poll_until(std::span<pollfd> descriptors, loop::Clock::time_point deadline) {
  // Compared before subtracted: time_point::min() minus now would overflow into the far future.
  const loop::Clock::time_point now = loop::Clock::now();
  const loop::Clock::duration left =
      deadline > now ? deadline - now : loop::Clock::duration::zero();
  const auto left_s = std::chrono::duration_cast<std::chrono::seconds>(left);
  const timespec timeout{left_s.count(), std::chrono::nanoseconds(left - left_s).count()};
  return ::ppoll(descriptors.data(), descriptors.size(), &timeout, nullptr);
}

}  // namespace tachless::bus

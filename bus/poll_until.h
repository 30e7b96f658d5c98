#pragma once

#include <poll.h>

#include <span>

#include "loop/clock.h"

namespace tachless::bus {

/// Waits until one of the descriptors is ready, `deadline` has come, or a signal has been handled.
/// @return as ppoll: how many are ready; 0 at the deadline; -1 with errno, EINTR for a signal
int poll_until(std::span<pollfd> descriptors, loop::Clock::time_point deadline);

}  // namespace tachless::bus

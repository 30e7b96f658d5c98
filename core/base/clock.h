#pragma once

#include <chrono>

namespace tachless::base {

using Clock = std::chrono::steady_clock;

/// Converts a time in seconds, as scenarios and options give it. Cuts off the part below 1 ns.
constexpr std::chrono::nanoseconds nanoseconds_of(double seconds) {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
      std::chrono::duration<double>(seconds));
}

/// Converts to seconds. The result is exact below 104 days (2^53 ns).
constexpr double seconds_of(std::chrono::nanoseconds duration) {
  return std::chrono::duration<double>(duration).count();
}

}  // namespace tachless::base

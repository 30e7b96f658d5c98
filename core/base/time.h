#pragma once

#include <chrono>

namespace tachless::base {

/// A time in seconds, as scenarios and options give it, for clocks; the rest below 1 ns is cut off.
constexpr std::chrono::nanoseconds nanoseconds_of(double seconds) {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
      std::chrono::duration<double>(seconds));
}

/// The other way round, exact below 104 days (2^53 ns).
constexpr double seconds_of(std::chrono::nanoseconds duration) {
  return std::chrono::duration<double>(duration).count();
}

}  // namespace tachless::base

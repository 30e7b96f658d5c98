#pragma once

#include <chrono>

namespace bus {

using Clock = std::chrono::steady_clock;

}  // namespace bus

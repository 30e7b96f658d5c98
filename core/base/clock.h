#pragma once

#include <chrono>

namespace tachless::base {

using Clock = std::chrono::steady_clock;

}  // namespace tachless::base

#pragma once

#include <chrono>

namespace tachless::loop {

using Clock = std::chrono::steady_clock;

}  // namespace tachless::loop

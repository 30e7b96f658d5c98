#pragma once

#include <string_view>

namespace tachless::loop {

/// Whether `parse_signals` (loop/signals.h) reads this text; allocates nothing.
[[nodiscard]] bool are_signals(std::string_view text);

}  // namespace tachless::loop

#pragma once

#include <functional>
#include <string_view>

namespace tachless::linear {

/// Callback with the present step of a computation; one thread calls it.
using OnProgress = std::function<void(std::string_view what)>;
inline void no_progress(std::string_view /*what*/) {}

/// Amount of computation. A smaller effort leaves numbers out. The remaining numbers are the same.
enum class Effort {
  quick,    ///< without margins; below 0.1 s for two joints
  margins,  ///< with margins, without missed ticks, which take seconds for seven joints
  full,
};

}  // namespace tachless::linear

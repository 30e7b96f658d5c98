#pragma once

#include <functional>
#include <string_view>

namespace tachless::linear {

/// Called with what is being computed; from one thread.
using OnProgress = std::function<void(std::string_view what)>;
inline void no_progress(std::string_view /*what*/) {}

/// How much is computed. Less effort leaves numbers out and gives no other ones.
enum class Effort {
  quick,    ///< without margins: well under 0.1 s for two joints, for every run
  margins,  ///< without missed ticks, which take seconds for seven joints
  full,
};

}  // namespace tachless::linear

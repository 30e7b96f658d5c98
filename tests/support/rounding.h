// The unit of the tests' bounds on rounding errors.
#pragma once

#include <limits>

namespace tachless {

inline constexpr double eps = std::numeric_limits<double>::epsilon();

}  // namespace tachless

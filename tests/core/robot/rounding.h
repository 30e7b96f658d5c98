// The unit of the tests' bounds on rounding errors.
#pragma once

#include <limits>

namespace tachless::robot {

inline constexpr double eps = std::numeric_limits<double>::epsilon();

}  // namespace tachless::robot

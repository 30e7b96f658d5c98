#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

namespace tachless::plant {

/// Returns the largest of `largest` and the relative errors. The error of an entry is relative to
/// the larger of 1 and the entry's magnitude in `x`. Returns NaN if an error is NaN. An integrator
/// then refuses the step.
template <class Values>
double step_error(const Values& error, const Values& x, double largest) {
  for (Eigen::Index i = 0; i < x.size(); ++i) {
    const double relative = std::abs(error[i]) / std::max(1.0, std::abs(x[i]));
    // Comparisons with NaN are false: without this line a later entry would replace it.
    if (std::isnan(relative)) return relative;
    if (relative > largest) largest = relative;
  }
  return largest;
}

}  // namespace tachless::plant

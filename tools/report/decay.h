#pragma once

#include <optional>
#include <vector>

#include "study/tracking.h"

namespace tachless::report {

/// Approximate bound |x(t)| <= amplitude exp(-rate (t - from_s)) between two instants.
struct Decay {
  double rate_per_s = 0;
  double amplitude = 0;  ///< bound at `from_s`
  double from_s = 0, to_s = 0;
};

/// Fits an exponential to the decaying part of a signal's magnitude.
///
/// The fit uses the upper envelope max over s >= t of |x(s)|, which ignores the zeros of an
/// oscillating signal. From its peak on, the logarithm of the envelope is a falling line up to an
/// instant and a constant after it. Least squares determines the instant. The slope of the line is
/// Theil and Sen's (median of slopes), which is robust against single outliers.
///
/// Returns nothing in three cases: the envelope falls by less than a factor of two along the line;
/// the rms deviation exceeds 20 % of the fall; there are too few points.
std::optional<Decay> fit_decay(const std::vector<study::Point>& magnitude);

}  // namespace tachless::report

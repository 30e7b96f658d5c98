#pragma once

#include <optional>
#include <vector>

#include "study/tracking.h"

namespace tachless::report {

/// |x(t)| <= amplitude exp(-rate (t - from_s)), roughly, between two instants.
struct Decay {
  double rate_per_s = 0;
  double amplitude = 0;  ///< at from_s
  double from_s = 0, to_s = 0;
};

/// The exponential that the decaying part of a signal's magnitude follows.
///
/// What is fitted is the upper envelope from now on, max over s >= t of |x(s)|: it does not see a
/// swinging signal's zeros. From its peak on, its logarithm is taken for a falling line up to an
/// instant and a constant after it, the instant being that of least squares; the line's slope is
/// then Theil and Sen's (median of slopes), which an odd spike does not move.
///
/// Nothing when the envelope falls by less than a factor of two along the line, or does not follow
/// it (by 20 % of the fall, rms), or there are too few points.
std::optional<Decay> fit_decay(const std::vector<study::Point>& magnitude);

}  // namespace tachless::report

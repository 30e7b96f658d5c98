#include "reference/trajectory/point_to_point.h"

#include <algorithm>

namespace tachless::reference::trajectory {
namespace {

/// p(s) for s <= 1/2, where its terms do not cancel.
double rise(double s) {
  return s * s * s * s * s * (126 + s * (-420 + s * (540 + s * (-315 + s * 70))));
}

}  // namespace

loop::ReferencePoint PointToPoint::at(double t_s) const {
  const double s = std::clamp((t_s - start_s) / duration_s, 0.0, 1.0);
  // p'(s) = 630 u^4 with u = s (1 - s); the rest follows with u' = 1 - 2 s, u'' = -2.
  const double u = s * (1 - s);
  const double u1 = 1 - 2 * s;
  const double rate = 1 / duration_s;
  const double v = 630 * u * u * u * u * rate;
  const double a = 2520 * u * u * u * u1 * rate * rate;
  const double jerk = 2520 * u * u * (3 - 14 * u) * rate * rate * rate;
  const double snap = 15120 * u * (1 - 7 * u) * u1 * rate * rate * rate * rate;

  const robot::Vector way = to - from;
  loop::ReferencePoint point;
  // p(s) = 1 - p(1 - s): each end is approached from itself, and reached exactly.
  if (s <= 0.5) {
    point.q_ref = from + rise(s) * way;
  } else {
    point.q_ref = to - rise(1 - s) * way;
  }
  point.v_ref = v * way;
  point.a_ref = a * way;
  point.jerk_ref = jerk * way;
  point.snap_ref = snap * way;
  return point;
}

}  // namespace tachless::reference::trajectory

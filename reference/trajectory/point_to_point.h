#pragma once

#include <algorithm>
#include <string_view>

#include "base/schema.h"
#include "messages/signals.h"
#include "reference/trajectory/composition.h"

namespace tachless::reference::trajectory {

/// Motion from one position to another along p(s), with s = (t - start) / duration:
///
///   p(s) = 126 s^5 - 420 s^6 + 540 s^7 - 315 s^8 + 70 s^9.
///
/// p is the only polynomial of degree 9 that is at rest through snap at both ends. The reference is
/// `from` before `start_s` and `to` after start_s + duration_s. It is C4 everywhere.
struct PointToPoint {
  Vector from_rad;  ///< [rad; m if prismatic]
  Vector to_rad;    ///< [rad; m if prismatic]
  double start_s = 0;
  double duration_s = 1;  ///< > 0

  static constexpr std::string_view name = "point_to_point";
  static constexpr std::tuple keys{
      base::Key{"from_rad", &PointToPoint::from_rad, "rad (m)",
                "Degree-9 polynomial, at rest through snap at both ends"},
      base::Key{"to_rad", &PointToPoint::to_rad, "rad (m)", "End of the motion"},
      base::Key{"start_s", &PointToPoint::start_s, "s", "Until then at `from_rad`"}
          .in(base::not_negative)
          .by_default(),
      base::Key{"duration_s", &PointToPoint::duration_s, "s",
                "Duration of the motion; after it at `to_rad`"}
          .in(base::positive)
          .by_default()};

  /// Returns position to snap at t [s], each in closed form.
  [[nodiscard]] messages::ReferencePoint at(double t_s) const;
  [[nodiscard]] Composition composition() const { return {{start_s, start_s + duration_s}, {}}; }

 private:
  /// Returns p(s) for s <= 1/2, for which its terms do not cancel.
  static double rise(double s) {
    return s * s * s * s * s * (126 + s * (-420 + s * (540 + s * (-315 + s * 70))));
  }
};

inline messages::ReferencePoint PointToPoint::at(double t_s) const {
  const double s = std::clamp((t_s - start_s) / duration_s, 0.0, 1.0);
  // p'(s) = 630 u^4 with u = s (1 - s). The higher derivatives follow with u' = 1 - 2 s and u'' =
  // -2.
  const double u = s * (1 - s);
  const double u1 = 1 - 2 * s;
  const double rate = 1 / duration_s;
  const double v = 630 * u * u * u * u * rate;
  const double a = 2520 * u * u * u * u1 * rate * rate;
  const double jerk = 2520 * u * u * (3 - 14 * u) * rate * rate * rate;
  const double snap = 15120 * u * (1 - 7 * u) * u1 * rate * rate * rate * rate;

  const Vector way = to_rad - from_rad;
  messages::ReferencePoint point;
  // p(s) = 1 - p(1 - s). Each half is computed from its own end, so that both ends are reached
  // exactly.
  if (s <= 0.5) {
    point.q_ref = from_rad + rise(s) * way;
  } else {
    point.q_ref = to_rad - rise(1 - s) * way;
  }
  point.v_ref = v * way;
  point.a_ref = a * way;
  point.jerk_ref = jerk * way;
  point.snap_ref = snap * way;
  return point;
}

}  // namespace tachless::reference::trajectory

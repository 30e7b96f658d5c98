#include "reference/trajectory/multi_sine.h"

#include <cmath>
#include <numbers>

namespace tachless::reference::trajectory {

loop::ReferencePoint MultiSine::at(double t_s) const {
  const robot::Vector zero = robot::Vector::Zero(offset.size());
  loop::ReferencePoint point{offset, zero, zero, zero, zero};
  for (const Sine& term : terms) {
    for (Eigen::Index i = 0; i < offset.size(); ++i) {
      const double w = 2 * std::numbers::pi * term.frequency_hz[i];
      const double angle = w * t_s + term.phase[i];
      const double s = term.amplitude[i] * std::sin(angle);
      const double c = term.amplitude[i] * std::cos(angle);
      point.q_ref[i] += s;
      point.v_ref[i] += w * c;
      point.a_ref[i] -= w * w * s;
      point.jerk_ref[i] -= w * w * w * c;
      point.snap_ref[i] += w * w * w * w * s;
    }
  }
  return point;
}

}  // namespace tachless::reference::trajectory

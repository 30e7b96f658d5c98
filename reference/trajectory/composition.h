#pragma once

#include <numbers>
#include <tuple>
#include <vector>

#include "base/elementary.h"
#include "base/schema.h"
#include "messages/signals.h"

namespace tachless::reference::trajectory {

/// One sine wave per joint; all vectors have one entry per joint.
struct Sine {
  Vector amplitude_rad;  ///< [rad; m if prismatic]
  Vector frequency_hz;   ///< [Hz]
  Vector phase_rad;      ///< [rad]

  static constexpr std::tuple keys{
      base::Key{"amplitude_rad", &Sine::amplitude_rad, "rad (m)",
                "amplitude sin(2π frequency t + phase)"},
      base::Key{"frequency_hz", &Sine::frequency_hz, "Hz", "Frequency"}.in(base::not_negative),
      base::Key{"phase_rad", &Sine::phase_rad, "rad", "Phase at t = 0"}.by_default(0)};

  /// Adds amplitude_i sin(2 pi frequency_i t + phase_i) and its derivatives.
  void add_to(messages::ReferencePoint& point, double t_s) const {
    for (Eigen::Index i = 0; i < amplitude_rad.size(); ++i) {
      const double w = 2 * std::numbers::pi * frequency_hz[i];
      const double angle = w * t_s + phase_rad[i];
      double s = 0, c = 0;
      base::sin_cos(angle, s, c);
      s *= amplitude_rad[i];
      c *= amplitude_rad[i];
      point.q_ref[i] += s;
      point.v_ref[i] += w * c;
      point.a_ref[i] -= w * w * s;
      point.jerk_ref[i] -= w * w * w * c;
      point.snap_ref[i] += w * w * w * w * s;
    }
  }
};

/// Parts of a trajectory. Sample times, periods and proved bounds of a motion are computed from
/// these parts. A trajectory that has neither pieces nor sines is constant.
struct Composition {
  /// Times between which the trajectory is one polynomial in t [s]: of degree 5, of degree 7 in the
  /// first and the last piece, of degree 9 in a single one. It is constant before and after them.
  std::vector<double> piece_times_s;
  std::vector<Sine> sines;  ///< waves for all t, added to the pieces
};

}  // namespace tachless::reference::trajectory

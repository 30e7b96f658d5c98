#pragma once

#include "loop/signals.h"

namespace tachless::reference::trajectory {

/// From one position to another along p(s) = 126 s^5 - 420 s^6 + 540 s^7 - 315 s^8 + 70 s^9,
/// s = (t - start) / duration: the one polynomial of degree 9 that is at rest through snap at both
/// ends. Before `start_s` it holds `from`, after start_s + duration_s `to`, so it is C4 everywhere.
struct PointToPoint {
  robot::Vector from;  ///< [rad; m if prismatic]
  robot::Vector to;    ///< [rad; m if prismatic]
  double start_s = 0;
  double duration_s = 1;  ///< > 0

  /// Position to snap at t [s], each in closed form.
  [[nodiscard]] loop::ReferencePoint at(double t_s) const;
};

}  // namespace tachless::reference::trajectory

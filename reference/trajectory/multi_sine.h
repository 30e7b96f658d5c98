#pragma once

#include <vector>

#include "loop/signals.h"

namespace tachless::reference::trajectory {

/// One sinusoid per joint; all vectors have one entry per joint.
struct Sine {
  robot::Vector amplitude;     ///< [rad; m if prismatic]
  robot::Vector frequency_hz;  ///< [Hz]
  robot::Vector phase;         ///< [rad]
};

/// q_ref_i(t) = offset_i + sum over terms of amplitude_i sin(2 pi frequency_i t + phase_i),
/// for all t. With one term it is the plain sinusoid.
struct MultiSine {
  robot::Vector offset;  ///< [rad; m if prismatic]
  std::vector<Sine> terms;

  /// Position to snap at t [s], each differentiated in closed form.
  [[nodiscard]] loop::ReferencePoint at(double t_s) const;
};

}  // namespace tachless::reference::trajectory

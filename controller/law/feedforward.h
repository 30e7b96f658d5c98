#pragma once

#include "loop/signals.h"

namespace tachless::controller::law {

/// v_ref and vdot_ref of a feed-forward.
struct Feedforward {
  robot::Vector v_ref;  ///< [rad/s]
  robot::Vector a_ref;  ///< [rad/s^2]
};

/// The reference's velocity and acceleration `lead_s` ahead, by Taylor expansion through snap. A
/// torque held over a tick acts, on average, half a tick (and the command's delay) late; a
/// feed-forward that much ahead makes up for it. Position, error and filter stay where they are:
/// they answer to what was measured.
inline Feedforward feedforward_ahead(const loop::ReferencePoint& reference, double lead_s) {
  const double h = lead_s;
  return {reference.v_ref +
              h * (reference.a_ref + h / 2 * (reference.jerk_ref + h / 3 * reference.snap_ref)),
          reference.a_ref + h * (reference.jerk_ref + h / 2 * reference.snap_ref)};
}

}  // namespace tachless::controller::law

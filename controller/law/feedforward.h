#pragma once

#include "loop/signals.h"
#include "robot/inverse_dynamics.h"
#include "robot/jet.h"

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

/// ID(q, v_ref, vdot_ref) of the links, exact with its first two time derivatives where `q` has
/// its own and the reference is given up to snap [N m].
inline robot::JetVector feedforward_torque(const robot::Model& links, const robot::JetVector& q,
                                           const loop::ReferencePoint& reference) {
  const loop::ReferencePoint& r = reference;
  return robot::inverse_dynamics(links, q, robot::jet(r.v_ref, r.a_ref, r.jerk_ref),
                                 robot::jet(r.a_ref, r.jerk_ref, r.snap_ref));
}

/// The same on the reference itself: q = q_ref.
inline robot::JetVector feedforward_torque(const robot::Model& links,
                                           const loop::ReferencePoint& reference) {
  return feedforward_torque(links, robot::jet(reference.q_ref, reference.v_ref, reference.a_ref),
                            reference);
}

}  // namespace tachless::controller::law

#pragma once

#include "robot/model.h"
#include "scenario/scenario.h"

/// The largest feed-forward of a law over all postures.
namespace tachless::certify {

struct FeedforwardBound {
  Vector torque;        ///< largest |ID(q, v_ref, vdot_ref) + friction| of each joint [N m; N]
  bool proved = false;  ///< the bound holds over all postures and times; false: at sampled ones
};

/// Returns the bound over all postures q and all times of the run, with the friction that is fed
/// forward. It is proved for one revolute joint, and for two if M and C depend on the second angle
/// alone. For other robots it is evaluated at sampled postures and instants.
///
/// Proof. For fixed v_ref and vdot_ref each torque is a trigonometric polynomial in the angles q,
/// of degree sigma in each angle. Let S be its largest value over all q. Bernstein's inequality
/// bounds the second derivative by sigma^2 S. S is therefore at most the largest value on a grid,
/// divided by 1 - (sigma step)^2 / 8 for each joint. Let two instants be dt apart. Between them the
/// torque differs from its chord by at most dt^2 / 8 times its second derivative along the motion.
/// The bounds of the reference's velocity to snap bound this derivative.
/// @throw base::Failure(bad_usage) if law, robot or reference cannot be made of the scenario
FeedforwardBound feedforward_bound(const scenario::Scenario& scenario);

}  // namespace tachless::certify

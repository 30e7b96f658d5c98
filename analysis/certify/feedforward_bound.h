#pragma once

#include "robot/model.h"
#include "scenario/scenario.h"

/// The largest feed-forward of a law over all postures.
namespace tachless::certify {

struct FeedforwardBound {
  Vector torque;        ///< largest |ID(q, v_ref, vdot_ref) + friction| of each joint [N m; N]
  bool proved = false;  ///< over all postures and times; false: at sampled ones
};

/// Returns the bound over all postures q and all times of the run, with the friction that is fed
/// forward. It is proved for one revolute joint and for two whose bodies hang on the first. Others
/// are sampled.
///
/// Proof. For fixed v_ref and vdot_ref each torque is a trigonometric polynomial of q, in which a
/// joint turns at most sigma times per radian. With the largest value S over all q, Bernstein's
/// inequality bounds the second derivative by sigma^2 S, so that S is at most the largest value on
/// a grid over 1 - (sigma step)^2 / 8 for each joint. Between two instants dt apart the torque is
/// off its chord by at most dt^2 / 8 times its second derivative along the motion, which bounds of
/// velocity to snap bound.
/// @throw base::Failure(bad_usage)
FeedforwardBound feedforward_bound(const scenario::Scenario& scenario);

}  // namespace tachless::certify

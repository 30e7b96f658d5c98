#pragma once

#include <Eigen/Core>
#include <optional>

#include "lyapunov/error_form.h"
#include "numerics/postures.h"

/// A region of an `ErrorForm` at every posture of a two-joint arm and at every instant. It is a
/// proof if the values between the postures of a circle are bounded (numerics::Postures).
namespace tachless::lyapunov {

/// A loop with bounds of what depends on posture and reference:
///
///   M eddot + [C(q, v) + Cd + D] edot = Gam y + F d,   ydot = Fy y + Fe edot + E d,
///   |d_i| <= sum_k most_ik |x_k|,   x = (y, edot).
struct BoundedForm {
  ErrorForm constant;       ///< Fy, Fe, Gam, damping; the other members are those of each posture
  Eigen::MatrixXd E, F;     ///< matrices by which d enters
  Eigen::MatrixXd most;     ///< one row per joint
  Eigen::MatrixXd v_scale;  ///< |v_scale^-1 v_ref| <= 1; empty: the reference is constant
};

/// Returns the region of given weights; its level is 0 where nothing is proved.
FormRegion proved_region(const BoundedForm& loop, const numerics::Postures& postures,
                         const FormWeights& weights);

/// Bounds of gradients of the links' torque ID(q, v_ref, a_ref) and of its rate R, at every posture
/// of an arm of two joints.
struct TorqueGradients {
  Eigen::MatrixXd of_torque;  ///< |dID_i / dq_j| [N m/rad]
  Eigen::MatrixXd of_rate;    ///< |dR_i / dq_j| [N m/(rad s)]
};

/// Returns the bounds for references whose |v_ref|, |a_ref| and |jerk_ref| are at most these in
/// each joint. Returns nothing unless the arm has two revolute joints, and no body turns by more
/// than its joint.
std::optional<TorqueGradients> torque_gradients(const robot::Model& model, const Vector& v,
                                                const Vector& a, const Vector& jerk);

}  // namespace tachless::lyapunov

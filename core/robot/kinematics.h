#pragma once

#include <string>

#include "robot/jet.h"
#include "robot/model.h"

/// Forward kinematics.
namespace tachless::robot {

/// A point or direction.
template <class Scalar>
using Vector3Of = Eigen::Matrix<Scalar, 3, 1>;
/// A rotation.
template <class Scalar>
using Matrix3Of = Eigen::Matrix<Scalar, 3, 3>;

/// A frame F in another, P: p_P = R p_F + p.
template <class Scalar>
struct Pose {
  Matrix3Of<Scalar> R;  ///< columns: F's axes in P
  Vector3Of<Scalar> p;  ///< [m]

  /// Returns the pose in P of a frame given in F.
  Pose operator*(const Pose& X) const { return {R * X.R, R * X.p + p}; }
};

/// Returns the body's frame in its parent's at joint positions `q` [rad; m]. A revolute joint turns
/// by Rodrigues' formula, multiplied by the constant rotation: R_PB (a a' + cos (1 - a a') + sin
/// [a]x).
template <class Scalar>
Pose<Scalar> joint_pose(const Body& body, const VectorOf<Scalar>& q) {
  const Scalar q_tree = body.multiplier * q[body.coordinate] + body.offset;
  const Eigen::Matrix3d& R = body.R_PB;
  const Eigen::Vector3d& a = body.axis_B;
  const Eigen::Vector3d direction = R * a;
  if (body.type == JointType::prismatic) {
    return {R.cast<Scalar>(), body.p_PB + direction * q_tree};
  }
  Scalar s, c;
  sin_cos(q_tree, s, c);
  const Eigen::Matrix3d along = direction * a.transpose(), across = R - along;
  Eigen::Matrix3d turned;
  turned << R.col(1) * a[2] - R.col(2) * a[1], R.col(2) * a[0] - R.col(0) * a[2],
      R.col(0) * a[1] - R.col(1) * a[0];
  return {along + across * c + turned * s, body.p_PB.cast<Scalar>()};
}

/// Returns the frame's pose in the root link's frame at joint positions `q` [rad; m].
Pose<double> frame_pose(const Model& model, const Frame& frame, const Vector& q);

/// Returns the same pose for a URDF link by name.
/// @throw std::invalid_argument when the model has no such link.
Pose<double> frame_pose(const Model& model, const std::string& link, const Vector& q);

/// Returns the torques [N m; N] on the joints of a force in the world [N] at point `p_F` of the
/// frame [m]: J(q)' force.
Vector force_torque(const Model& model, const Frame& frame, const Eigen::Vector3d& p_F,
                    const Eigen::Vector3d& force, const Vector& q);

/// Throws std::logic_error unless `x` has one entry per coordinate: a violated precondition.
void require_size(const Model& model, Eigen::Index size, const char* what);

}  // namespace tachless::robot

#pragma once

#include <Eigen/Geometry>
#include <string>

#include "robot/jet.h"
#include "robot/model.h"
#include "robot/triple.h"

/// Forward kinematics, templated on the scalar (double or Jet2).
namespace tachless::robot {

template <class Scalar>
using Vector3Of = Eigen::Matrix<Scalar, 3, 1>;
template <class Scalar>
using Matrix3Of = Eigen::Matrix<Scalar, 3, 3>;

/// A frame F in another, P: p_P = R p_F + p.
template <class Scalar>
struct Pose {
  Matrix3Of<Scalar> R;
  Vector3Of<Scalar> p;  ///< [m]
};

template <class Scalar>
Vector3Of<Scalar> scaled(const Eigen::Vector3d& a, const Scalar& s) {
  return {a[0] * s, a[1] * s, a[2] * s};
}

/// The tree's joint position q_tree = multiplier q[coordinate] + offset.
template <class Scalar>
Scalar tree_position(const Body& body, const VectorOf<Scalar>& q) {
  return body.multiplier * q[body.coordinate] + body.offset;
}

/// What of a joint's frame its position does not change. Revolute, by Rodrigues, the constant
/// rotation multiplied in beforehand: R_PB (a a' + cos (1 - a a') + sin [a]x).
struct JointConstants {
  TACHLESS_INLINE explicit JointConstants(const Body& body) {
    const Turn<double> R = turn(body.R_PB);
    const Triple<double> a = triple(body.axis_B);
    direction = R * a;
    const Triple<double> x = column(R, 0), y = column(R, 1), z = column(R, 2);
    along[0] = direction * a.x, along[1] = direction * a.y, along[2] = direction * a.z;
    across[0] = x - along[0], across[1] = y - along[1], across[2] = z - along[2];
    turned[0] = y * a.z - z * a.y, turned[1] = z * a.x - x * a.z, turned[2] = x * a.y - y * a.x;
  }
  Triple<double> direction;                       ///< of the axis, in the parent's frame
  Triple<double> along[3], across[3], turned[3];  ///< columns: constant, times cosine, times sine
};

/// The body's frame in its parent's, with its joint at `q_tree` [rad; m]: rotation, column by
/// column, and origin [m].
template <class Scalar>
TACHLESS_INLINE void set_joint_pose(const Body& body, const JointConstants& joint,
                                    const Scalar& q_tree, Scalar* R, Scalar* p) {
  const Triple<double> origin = triple(body.p_PB);
  if (body.type == JointType::revolute) {
    Scalar s, c;
    sin_cos(q_tree, s, c);
    const auto set = [&](int j) {
      const Triple<Scalar> turned = joint.across[j] * c, rest = joint.turned[j] * s;
      R[3 * j] = joint.along[j].x + turned.x + rest.x;
      R[3 * j + 1] = joint.along[j].y + turned.y + rest.y;
      R[3 * j + 2] = joint.along[j].z + turned.z + rest.z;
    };
    set(0), set(1), set(2);
    p[0] = origin.x, p[1] = origin.y, p[2] = origin.z;
  } else {
    for (int i = 0; i < 9; ++i) R[i] = body.R_PB.data()[i];
    const Triple<Scalar> moved = joint.direction * q_tree;
    p[0] = origin.x + moved.x, p[1] = origin.y + moved.y, p[2] = origin.z + moved.z;
  }
}

template <class Scalar>
Pose<Scalar> joint_pose(const Body& body, const Scalar& q_tree) {
  Pose<Scalar> X;
  set_joint_pose(body, JointConstants(body), q_tree, X.R.data(), X.p.data());
  return X;
}

/// The frame's pose in the root link's frame at joint positions `q` [rad; m].
template <class Scalar>
Pose<Scalar> frame_pose(const Model& model, const Frame& frame, const VectorOf<Scalar>& q);

/// The same for a URDF link by name.
/// @throw std::invalid_argument when the model has no such link.
template <class Scalar>
Pose<Scalar> frame_pose(const Model& model, const std::string& link, const VectorOf<Scalar>& q);

/// Torques [N m; N] that a force in the world [N], at point `p_F` of the frame [m], puts on the
/// joints: J(q)' force.
Vector force_torque(const Model& model, const Frame& frame, const Eigen::Vector3d& p_F,
                    const Eigen::Vector3d& force, const Vector& q);

/// Throws std::logic_error unless `x` has one entry per coordinate: a caller's broken promise.
void require_size(const Model& model, Eigen::Index size, const char* what);

}  // namespace tachless::robot

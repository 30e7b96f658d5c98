#pragma once

#include <Eigen/Geometry>
#include <string>

#include "robot/jet.h"
#include "robot/model.h"

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

/// The body's frame in its parent's, with its joint at `q_tree` [rad; m]: rotation, column by
/// column, and origin [m].
template <class Scalar>
[[gnu::always_inline]] inline void set_joint_pose(const Body& body, const Scalar& q_tree, Scalar* R,
                                                  Scalar* p) {
  const double* r = body.R_PB.data();
  const double* a = body.axis_B.data();
  // Along the axis, in the parent's frame.
  const double d[3] = {r[0] * a[0] + r[3] * a[1] + r[6] * a[2],
                       r[1] * a[0] + r[4] * a[1] + r[7] * a[2],
                       r[2] * a[0] + (r[5] * a[1] + r[8] * a[2])};
  if (body.type == JointType::revolute) {
    // Rodrigues, the constant rotation multiplied in beforehand:
    // R_PB (a a' + cos (1 - a a') + sin [a]x).
    Scalar s, c;
    sin_cos(q_tree, s, c);
    for (int j = 0; j < 3; ++j) {
      const int k = (j + 1) % 3, l = (j + 2) % 3;
      for (int i = 0; i < 3; ++i) {
        const double along = d[i] * a[j];
        const double across = r[i + 3 * j] - along;
        const double turned = r[i + 3 * k] * a[l] - r[i + 3 * l] * a[k];
        R[i + 3 * j] = along + across * c + turned * s;
      }
    }
    for (int i = 0; i < 3; ++i) p[i] = body.p_PB[i];
  } else {
    for (int i = 0; i < 9; ++i) R[i] = r[i];
    for (int i = 0; i < 3; ++i) p[i] = body.p_PB[i] + d[i] * q_tree;
  }
}

template <class Scalar>
Pose<Scalar> joint_pose(const Body& body, const Scalar& q_tree) {
  Pose<Scalar> X;
  set_joint_pose(body, q_tree, X.R.data(), X.p.data());
  return X;
}

/// The frame's pose in the root link's frame at joint positions `q` [rad; m].
template <class Scalar>
Pose<Scalar> frame_pose(const Model& model, const Frame& frame, const VectorOf<Scalar>& q);

/// The same for a URDF link by name.
/// @throw std::invalid_argument when the model has no such link.
template <class Scalar>
Pose<Scalar> frame_pose(const Model& model, const std::string& link, const VectorOf<Scalar>& q);

/// Position of a URDF link's origin in the root link's frame [m].
/// @throw std::invalid_argument when the model has no such link.
inline Eigen::Vector3d link_position(const Model& model, const std::string& link, const Vector& q) {
  return frame_pose<double>(model, link, q).p;
}

/// Torques [N m; N] that a force in the world [N], at point `p_F` of the frame [m], puts on the
/// joints: J(q)' force.
Vector force_torque(const Model& model, const Frame& frame, const Eigen::Vector3d& p_F,
                    const Eigen::Vector3d& force, const Vector& q);

/// Throws std::logic_error unless `x` has one entry per coordinate: a caller's broken promise.
void require_size(const Model& model, Eigen::Index size, const char* what);

extern template Pose<double> frame_pose(const Model&, const Frame&, const VectorOf<double>&);
extern template Pose<Jet2> frame_pose(const Model&, const Frame&, const VectorOf<Jet2>&);
extern template Pose<double> frame_pose(const Model&, const std::string&, const VectorOf<double>&);
extern template Pose<Jet2> frame_pose(const Model&, const std::string&, const VectorOf<Jet2>&);

}  // namespace tachless::robot

#pragma once

#include "robot/kinematics.h"
#include "robot/triple.h"

/// What the recursions of this room share. Not for other rooms.
namespace tachless::robot {

/// A body's frame in its parent's: p_P = R p_B + p.
template <class Scalar>
struct JointFrame {
  Turn<Scalar> R;
  Triple<Scalar> p;  ///< [m]
};

/// A body with all that hangs on it, frozen; about and in the body's frame.
template <class Scalar>
struct Composite {
  Triple<Scalar> h;  ///< mass times centre of mass [kg m]
  Turn<Scalar> I;    ///< about the body's origin [kg m2]
  double mass;
};

/// Where each body stands in an order in which every subtree is in one piece, and how many bodies
/// that has.
struct Preorder {
  void set(const std::vector<Body>& bodies);
  int place[max_bodies], size[max_bodies], body[max_bodies];
};

/// What of the recursions depends on the model alone.
struct ModelConstants {
  explicit ModelConstants(const Model& model);
  std::vector<JointConstants> joints;        ///< by body
  std::vector<Composite<double>> composite;  ///< by body, of the body alone
  Preorder order;
};

/// The frames of all bodies at joint positions `q`, into an array of `max_bodies`.
template <class Scalar>
TACHLESS_INLINE void set_joint_frames(const Model& model, const VectorOf<Scalar>& q,
                                      JointFrame<Scalar>* frames,
                                      const ModelConstants* constants = nullptr) {
  require_size(model, q.size(), "q");
  const std::size_t n = model.bodies.size();
  for (std::size_t i = 0; i < n; ++i) {
    const Body& body = model.bodies[i];
    set_joint_pose(body, constants != nullptr ? constants->joints[i] : JointConstants(body),
                   tree_position(body, q), frames[i].R.m, &frames[i].p.x);
  }
}

/// `mass_matrix` at the posture of these frames, into M.
template <class Scalar>
void set_mass_matrix(const Model& model, const JointFrame<Scalar>* frames, MatrixOf<Scalar>& M,
                     const ModelConstants* constants = nullptr);

}  // namespace tachless::robot

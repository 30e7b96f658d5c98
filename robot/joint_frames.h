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

/// The frames of all bodies at joint positions `q`, into an array of `max_bodies`.
template <class Scalar>
TACHLESS_INLINE void set_joint_frames(const Model& model, const VectorOf<Scalar>& q,
                                      JointFrame<Scalar>* frames) {
  require_size(model, q.size(), "q");
  const std::size_t n = model.bodies.size();
  for (std::size_t i = 0; i < n; ++i) {
    const Body& body = model.bodies[i];
    set_joint_pose(body, tree_position(body, q), frames[i].R.m, &frames[i].p.x);
  }
}

/// `mass_matrix` at the posture of these frames, into M.
template <class Scalar>
void set_mass_matrix(const Model& model, const JointFrame<Scalar>* frames, MatrixOf<Scalar>& M);

/// `inverse_dynamics` at the posture of these frames.
template <class Scalar>
VectorOf<Scalar> inverse_dynamics(const Model& model, const JointFrame<Scalar>* frames,
                                  const VectorOf<Scalar>& v, const VectorOf<Scalar>& a);

}  // namespace tachless::robot

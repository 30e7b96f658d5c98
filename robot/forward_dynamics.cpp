#include "robot/forward_dynamics.h"

#include <stdexcept>

#include "robot/cholesky.h"
#include "robot/joint_frames.h"

namespace tachless::robot {

template <class Scalar>
void equations_of_motion(const Model& model, const VectorOf<Scalar>& q, const VectorOf<Scalar>& v,
                         MatrixOf<Scalar>& M, VectorOf<Scalar>& bias) {
  JointFrame<Scalar> frames[max_bodies];
  set_joint_frames(model, q, frames);
  VectorOf<Scalar> a(model.num_joints);
  for (int j = 0; j < model.num_joints; ++j) a[j] = Scalar(0);
  bias = inverse_dynamics(model, frames, v, a);
  set_mass_matrix(model, frames, M);
}

template <class Scalar>
VectorOf<Scalar> forward_dynamics(const Model& model, const VectorOf<Scalar>& q,
                                  const VectorOf<Scalar>& v, const VectorOf<Scalar>& tau) {
  require_size(model, tau.size(), "tau");
  MatrixOf<Scalar> M;
  VectorOf<Scalar> a;
  equations_of_motion(model, q, v, M, a);
  for (int j = 0; j < model.num_joints; ++j) a[j] = tau[j] - a[j];
  const int failed = factorise(M);
  if (failed >= 0) {
    throw std::logic_error("robot: the inertia matrix is not positive definite at joint '" +
                           model.joint_names[failed] + "'");
  }
  solve_in_place(M, a);
  return a;
}

template void equations_of_motion(const Model&, const VectorOf<double>&, const VectorOf<double>&,
                                  MatrixOf<double>&, VectorOf<double>&);
template VectorOf<double> forward_dynamics(const Model&, const VectorOf<double>&,
                                           const VectorOf<double>&, const VectorOf<double>&);
template VectorOf<Jet2> forward_dynamics(const Model&, const VectorOf<Jet2>&, const VectorOf<Jet2>&,
                                         const VectorOf<Jet2>&);

}  // namespace tachless::robot

#include "robot/forward_dynamics.h"

#include <stdexcept>

#include "robot/cholesky.h"
#include "robot/inverse_dynamics.h"
#include "robot/kinematics.h"
#include "robot/mass_matrix.h"

namespace tachless::robot {

template <class Scalar>
VectorOf<Scalar> forward_dynamics(const Model& model, const VectorOf<Scalar>& q,
                                  const VectorOf<Scalar>& v, const VectorOf<Scalar>& tau) {
  require_size(model, tau.size(), "tau");
  VectorOf<Scalar> a(model.num_joints);
  for (int j = 0; j < model.num_joints; ++j) a[j] = Scalar(0);
  const VectorOf<Scalar> bias = inverse_dynamics(model, q, v, a);
  for (int j = 0; j < model.num_joints; ++j) a[j] = tau[j] - bias[j];
  MatrixOf<Scalar> M = mass_matrix(model, q);
  const int failed = factorise(M);
  if (failed >= 0) {
    throw std::logic_error("robot: the inertia matrix is not positive definite at joint '" +
                           model.joint_names[failed] + "'");
  }
  solve_in_place(M, a);
  return a;
}

template VectorOf<double> forward_dynamics(const Model&, const VectorOf<double>&,
                                           const VectorOf<double>&, const VectorOf<double>&);
template VectorOf<Jet2> forward_dynamics(const Model&, const VectorOf<Jet2>&, const VectorOf<Jet2>&,
                                         const VectorOf<Jet2>&);

}  // namespace tachless::robot

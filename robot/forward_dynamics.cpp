#include "robot/forward_dynamics.h"

#include <stdexcept>
#include <utility>

#include "robot/cholesky.h"
#include "robot/joint_frames.h"

namespace tachless::robot {

namespace {

template <class Scalar>
TACHLESS_INLINE void evaluate(const Model& model, const VectorOf<Scalar>& q,
                              const VectorOf<Scalar>& v, MatrixOf<Scalar>& M,
                              VectorOf<Scalar>& bias, const ModelConstants* constants) {
  JointFrame<Scalar> frames[max_bodies];
  set_joint_frames(model, q, frames, constants);
  bias = bias_torque(model, frames, v);
  set_mass_matrix(model, frames, M, constants);
}

}  // namespace

EquationsOfMotion::EquationsOfMotion(Model model)
    : model_(std::move(model)), constants_(std::make_unique<ModelConstants>(model_)) {}
EquationsOfMotion::~EquationsOfMotion() = default;

void EquationsOfMotion::evaluate(const Vector& q, const Vector& v) {
  robot::evaluate(model_, q, v, M, bias, constants_.get());
}

template <class Scalar>
VectorOf<Scalar> forward_dynamics(const Model& model, const VectorOf<Scalar>& q,
                                  const VectorOf<Scalar>& v, const VectorOf<Scalar>& tau) {
  require_size(model, tau.size(), "tau");
  MatrixOf<Scalar> M;
  VectorOf<Scalar> a;
  evaluate(model, q, v, M, a, nullptr);
  for (int j = 0; j < model.num_joints; ++j) a[j] = tau[j] - a[j];
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

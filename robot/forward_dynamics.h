#pragma once

#include <memory>

#include "robot/jet.h"
#include "robot/model.h"

namespace tachless::robot {

struct ModelConstants;

/// M(q), as `mass_matrix`, and C(q,v) v + g(q) [N m; N], as `inverse_dynamics`, of one model at
/// many states, to the same last bit: what the model alone determines is computed once, the joints'
/// frames once for both. Nothing is allocated after the constructor.
class EquationsOfMotion {
 public:
  explicit EquationsOfMotion(Model model);
  EquationsOfMotion(const EquationsOfMotion&) = delete;
  EquationsOfMotion& operator=(const EquationsOfMotion&) = delete;
  ~EquationsOfMotion();

  /// Sets M and bias. @throw std::logic_error when a size is wrong.
  void evaluate(const Vector& q, const Vector& v);

  Matrix M;
  Vector bias;

 private:
  const Model model_;
  std::unique_ptr<const ModelConstants> constants_;
};

/// Acceleration [rad/s2; m/s2] that torque `tau` [N m; N] gives at (q, v): M(q)^-1 (tau - C(q,v) v
/// - g(q)) (paper, eq. 2). Scalars: double and Jet2. Nothing is allocated.
/// @throw std::logic_error when a size is wrong or M(q) is not positive definite, which
/// `model_from_urdf` has ruled out but for single postures.
template <class Scalar>
VectorOf<Scalar> forward_dynamics(const Model& model, const VectorOf<Scalar>& q,
                                  const VectorOf<Scalar>& v, const VectorOf<Scalar>& tau);

}  // namespace tachless::robot

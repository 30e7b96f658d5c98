#pragma once

#include "robot/jet.h"
#include "robot/model.h"

namespace tachless::robot {

/// M(q), as `mass_matrix`, and C(q,v) v + g(q) [N m; N], as `inverse_dynamics`, at once: the
/// joints' frames are computed once for both.
template <class Scalar>
void equations_of_motion(const Model& model, const VectorOf<Scalar>& q, const VectorOf<Scalar>& v,
                         MatrixOf<Scalar>& M, VectorOf<Scalar>& bias);

/// Acceleration [rad/s2; m/s2] that torque `tau` [N m; N] gives at (q, v): M(q)^-1 (tau - C(q,v) v
/// - g(q)) (paper, eq. 2). Scalars: double and Jet2. Nothing is allocated.
/// @throw std::logic_error when a size is wrong or M(q) is not positive definite, which
/// `model_from_urdf` has ruled out but for single postures.
template <class Scalar>
VectorOf<Scalar> forward_dynamics(const Model& model, const VectorOf<Scalar>& q,
                                  const VectorOf<Scalar>& v, const VectorOf<Scalar>& tau);

extern template void equations_of_motion(const Model&, const VectorOf<double>&,
                                         const VectorOf<double>&, MatrixOf<double>&,
                                         VectorOf<double>&);
extern template VectorOf<double> forward_dynamics(const Model&, const VectorOf<double>&,
                                                  const VectorOf<double>&, const VectorOf<double>&);
extern template VectorOf<Jet2> forward_dynamics(const Model&, const VectorOf<Jet2>&,
                                                const VectorOf<Jet2>&, const VectorOf<Jet2>&);

}  // namespace tachless::robot

#pragma once

#include "robot/jet.h"
#include "robot/model.h"

/// Recursive Newton-Euler: free functions of a constant model and values, O(n), nothing allocated.
/// Scalars: double and Jet2.
///
/// C is the Christoffel one: Mdot - 2C is skew and C(q,x) y = C(q,y) x, so C(q,x) y is the
/// polarisation of the quadratic term C(q,v) v that the recursion computes. With mimic joints,
/// q_tree = G q + offset, every function here is G' f_tree(G q + offset, G v, G a).
///
/// A vector whose size is not the model's `num_joints` is a caller's broken promise:
/// std::logic_error.
namespace tachless::robot {

/// M(q) a + C(q,v) v + g(q) [N m; N] (paper, eq. 2), rotor inertia included.
/// @param q [rad; m]  @param v [rad/s; m/s]  @param a [rad/s2; m/s2]
template <class Scalar>
VectorOf<Scalar> inverse_dynamics(const Model& model, const VectorOf<Scalar>& q,
                                  const VectorOf<Scalar>& v, const VectorOf<Scalar>& a);

/// M(q) a + C(q,x) y + g(q) [N m; N], rotor inertia included: feed-forward at two velocities.
template <class Scalar>
VectorOf<Scalar> inverse_dynamics_bilinear(const Model& model, const VectorOf<Scalar>& q,
                                           const VectorOf<Scalar>& x, const VectorOf<Scalar>& y,
                                           const VectorOf<Scalar>& a);

/// C(q,x) y [N m; N]; symmetric in x and y to the last bit.
template <class Scalar>
VectorOf<Scalar> coriolis_product(const Model& model, const VectorOf<Scalar>& q,
                                  const VectorOf<Scalar>& x, const VectorOf<Scalar>& y);

/// g(q) [N m; N].
template <class Scalar>
VectorOf<Scalar> gravity_torque(const Model& model, const VectorOf<Scalar>& q);

/// C(q,v), column by column as C(q,v) e_j.
template <class Scalar>
MatrixOf<Scalar> coriolis_matrix(const Model& model, const VectorOf<Scalar>& q,
                                 const VectorOf<Scalar>& v);

}  // namespace tachless::robot

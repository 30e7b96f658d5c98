#pragma once

#include <vector>

#include "robot/jet.h"
#include "robot/model.h"

/// Mechanics of a constant model: inertia matrix by composite bodies, inverse dynamics by recursive
/// Newton-Euler, forward dynamics, energy. The functions are free functions of values, templates
/// for the scalars double and Jet2. Only `coriolis_matrices` allocates. Friction, springs and
/// drives are left out.
///
/// C is defined by the Christoffel symbols: Mdot - 2C is skew-symmetric and C(q,x) y = C(q,y) x, so
/// C(q,x) y is the polarisation of the quadratic term C(q,v) v that the recursion computes. With
/// mimic joints, q_tree = G q + offset, every torque here is G' f_tree(G q + offset, G v, G a).
///
/// A vector whose size is not the model's `num_joints` is a violated precondition:
/// std::logic_error.
namespace tachless::robot {

/// Returns M(q) [kg m2; kg m; kg], rotor inertia on the diagonal included. The result is symmetric
/// to the last bit.
template <class Scalar>
MatrixOf<Scalar> mass_matrix(const Model& model, const VectorOf<Scalar>& q);

/// Returns M(q) a + C(q,v) v + g(q) [N m; N] (paper, eq. 2), rotor inertia included, O(n).
/// @param q [rad; m]
/// @param v [rad/s; m/s]
/// @param a [rad/s2; m/s2]
template <class Scalar>
VectorOf<Scalar> inverse_dynamics(const Model& model, const VectorOf<Scalar>& q,
                                  const VectorOf<Scalar>& v, const VectorOf<Scalar>& a);

/// Returns M(q) a + C(q,x) y + g(q) [N m; N], rotor inertia included: feed-forward at two
/// velocities.
template <class Scalar>
VectorOf<Scalar> inverse_dynamics_bilinear(const Model& model, const VectorOf<Scalar>& q,
                                           const VectorOf<Scalar>& x, const VectorOf<Scalar>& y,
                                           const VectorOf<Scalar>& a);

/// Returns C(q,x) y [N m; N]; symmetric in x and y to the last bit.
Vector coriolis_product(const Model& model, const Vector& q, const Vector& x, const Vector& y);

/// Returns g(q) [N m; N].
Vector gravity_torque(const Model& model, const Vector& q);

/// Returns C(q,v), column by column as C(q,v) e_j.
Matrix coriolis_matrix(const Model& model, const Vector& q, const Vector& v);

/// Returns the matrices C(q, e_j) of all joints j [kg m2; kg m; kg]. C(q,x) = sum_j x_j C(q, e_j).
/// The matrices have the bits of `coriolis_product`.
std::vector<Eigen::MatrixXd> coriolis_matrices(const Model& model, const Vector& q);

/// Returns the acceleration [rad/s2; m/s2] under torque `tau` [N m; N] at (q, v):
/// M(q)^-1 (tau - C(q,v) v - g(q)) (paper, eq. 2).
/// @throw std::logic_error when M(q) is not positive definite; `model_from_urdf` rules this out
/// except at isolated postures.
Vector forward_dynamics(const Model& model, const Vector& q, const Vector& v, const Vector& tau);

/// Computes M(q) and bias = C(q,v) v + g(q) [N m; N], with the bits of `mass_matrix` and
/// `inverse_dynamics`.
void set_equations_of_motion(const Model& model, const Vector& q, const Vector& v, Matrix& M,
                             Vector& bias);

/// Returns the potential energy of gravity [J], zero for a mass at the root link's origin; g(q) is
/// its gradient.
template <class Scalar>
Scalar potential_energy(const Model& model, const VectorOf<Scalar>& q);

}  // namespace tachless::robot

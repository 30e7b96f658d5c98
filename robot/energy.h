#pragma once

#include "robot/jet.h"
#include "robot/model.h"

/// Mechanical energy, body by body: independent of the mass matrix. Scalars: double and Jet2.
namespace tachless::robot {

/// v' M(q) v / 2 [J], rotor inertia included.
template <class Scalar>
Scalar kinetic_energy(const Model& model, const VectorOf<Scalar>& q, const VectorOf<Scalar>& v);

/// Potential energy of gravity [J], zero for a mass at the root link's origin; g(q) is its
/// gradient.
template <class Scalar>
Scalar potential_energy(const Model& model, const VectorOf<Scalar>& q);

}  // namespace tachless::robot

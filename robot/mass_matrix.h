#pragma once

#include "robot/jet.h"
#include "robot/model.h"

namespace tachless::robot {

/// M(q) [kg m2; kg m; kg] by composite bodies, rotor inertia on the diagonal included. Symmetric
/// to the last bit. Scalars: double and Jet2. Nothing is allocated.
/// @throw std::logic_error when q has not the model's size.
template <class Scalar>
MatrixOf<Scalar> mass_matrix(const Model& model, const VectorOf<Scalar>& q);

}  // namespace tachless::robot

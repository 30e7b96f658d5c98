#pragma once

#include <string>

#include "scenario/scenario.h"

namespace tachless::lyapunov {

/// Returns the numbers, as JSON, by which the region of the loop as it is sampled can be proved.
/// tests/analysis/lyapunov/check_witness.py reads them and says what is claimed. They are scenario
/// numbers, L of V = |L' x|², and by how much V falls. P = L L' is chosen so that V falls for all
/// maps of the loop in an ellipsoid of positions and rates. The maps have frozen inertia and
/// Coriolis terms. The ellipsoid holds V <= 1. Only a region that the checker accepts is proved.
/// @param errors for which it is sought, of one joint alone from rest [rad]
/// @throw base::Failure(bad_usage) of a scenario that is not one of one or two revolute
/// rigid joints, `loria_ortega_rigid` and one tick of delay, and where no P is found.
std::string witness(const scenario::Scenario& scenario, const Vector& errors);

}  // namespace tachless::lyapunov

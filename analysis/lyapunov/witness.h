#pragma once

#include <string>

#include "scenario/scenario.h"

namespace tachless::lyapunov {

/// What the region of the loop as it is sampled can be proved with, as JSON for
/// tests/analysis/lyapunov/check_witness.py, which says what is claimed: scenario numbers, L of V =
/// |L' x|², and by how much V falls. P = L L' is chosen so that V falls for all maps of the loop,
/// with inertia and Coriolis terms frozen, in an ellipsoid of positions and rates that holds V
/// <= 1. Proved is what the checker accepts, and nothing before.
/// @param errors for which it is sought, of one joint alone from rest [rad]
/// @throw base::Failure(bad_usage) of a scenario that is not one of one or two revolute
/// rigid joints, `loria_ortega_rigid` and one tick of delay, and where no P is found.
std::string witness(const scenario::Scenario& scenario, const Vector& errors);

}  // namespace tachless::lyapunov

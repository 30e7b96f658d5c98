#pragma once

#include <string>

#include "scenario/scenario.h"

namespace tachless::lyapunov {

/// Returns, as JSON, the numbers by which the region of the sampled loop can be proved.
/// tools/cli/witness/check_witness.py reads them and prints what they claim. They are numbers
/// of the scenario, L of V = |L' x|², and the decrease of V. P = L L' is chosen so that V falls for
/// all maps of the loop in an ellipsoid of positions and rates. The maps have frozen inertia and
/// Coriolis terms. The ellipsoid holds V <= 1. Only a region that the checker accepts is proved.
/// @param errors initial errors, of one joint alone at rest, for which the region is sought [rad]
/// @throw base::Failure(bad_usage) where no P is found, and for a scenario other than one or two
/// revolute rigid joints, `loria_ortega_rigid` and one tick of delay.
std::string witness(const scenario::Scenario& scenario, const Vector& errors);

}  // namespace tachless::lyapunov

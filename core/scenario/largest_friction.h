#pragma once

#include "scenario/scenario.h"

namespace tachless::scenario {

/// Returns a bound of each joint's friction that is not viscous, at any speed and over all postures
/// [N m; N]. A joint may rest beside its reference by this over its stiffness. Friction that rises
/// with speed is in it, because no motion tells it from friction that holds at rest.
Vector largest_friction(const Scenario& scenario);

}  // namespace tachless::scenario

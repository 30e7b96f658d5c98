#pragma once

#include "scenario/scenario.h"

namespace tachless::scenario {

/// Returns a bound of each joint's friction at rest, static and by its load, over all postures
/// [N m; N]. A joint may rest beside its reference by this over its stiffness.
Vector largest_friction(const Scenario& scenario);

}  // namespace tachless::scenario

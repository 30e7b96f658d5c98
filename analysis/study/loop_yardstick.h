#pragma once

#include "scenario/scenario.h"
#include "study/verdict.h"

namespace tachless::study {

/// Sets `yardsticks.loop`, which `judge` calls for the numbers of the scenario's linearised loop at
/// rest. For an external law these numbers are unknown. `scenario` has to live as long as
/// `yardsticks`.
void add_loop(Yardsticks& yardsticks, const scenario::Scenario& scenario);

}  // namespace tachless::study

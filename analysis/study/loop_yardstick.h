#pragma once

#include "scenario/scenario.h"
#include "study/verdict.h"

namespace tachless::study {

/// Adds to `yardsticks` the numbers of the scenario's linearised loop at rest. They are computed
/// when `judge` asks for them. Nothing is known of an external law. The scenario has to live as
/// long as the yardsticks.
void add_loop(Yardsticks& yardsticks, const scenario::Scenario& scenario);

}  // namespace tachless::study

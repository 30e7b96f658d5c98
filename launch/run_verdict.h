#pragma once

#include "experiment/scenario.h"
#include "launch/run_plan.h"

namespace tachless::launch {

/// Says on stderr, in one line, whether the linearised loop of a run is stable at its rate, and
/// warns of what the reference asks in vain of drives and joints.
/// @throw diagnostics::Failure(bad_usage) for an unstable one without --force
void say_verdict(const experiment::Scenario& scenario, const RunOptions& options);

}  // namespace tachless::launch

#pragma once

#include "controller/registry.h"
#include "experiment/scenario.h"
#include "node/link.h"

namespace tachless::controller {

/// The controller process: runs `law` over the run of `scenario`, one step per tick, on the
/// measurements of the channel that belongs to the law's measurement type and on no other.
/// @throw diagnostics::Failure protocol_violated (two plants or references),
/// protective_stop (a torque that is not finite), and what the link throws.
void run_node(const experiment::Scenario& scenario, ScenarioLaw law, node::Link& link);

}  // namespace tachless::controller

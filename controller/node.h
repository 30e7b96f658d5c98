#pragma once

#include "controller/registry.h"
#include "scenario/scenario.h"
#include "session/session.h"

namespace tachless::controller {

/// The controller process: runs `law` over the run of `scenario`, one step per tick, on the
/// measurements of the channel that belongs to the law's measurement type and on no other.
/// @throw base::Failure protocol_violated (two plants or references),
/// protective_stop (a torque that is not finite), and what the session throws.
void run_node(const scenario::Scenario& scenario, ScenarioLaw law, session::Session& session);

}  // namespace tachless::controller

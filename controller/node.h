#pragma once

#include "controller/registry.h"
#include "scenario/scenario.h"
#include "session/session.h"

namespace tachless::controller {

/// Runs `law` over the run of `scenario` as the controller process, one step per tick. It receives
/// the measurements of the channel of the law's measurement type and no others.
/// @throw base::Failure: protocol_violated (two plants or references), protective_stop (a torque
/// that is not finite), and the failures of the session.
void run_node(const scenario::Scenario& scenario, ScenarioLaw law, session::Session& session);

}  // namespace tachless::controller

#pragma once

#include "bus/transport.h"
#include "controller/registry.h"
#include "experiment/scenario.h"
#include "node/session.h"

namespace tachless::controller {

/// The controller's loop in realtime: acts on the newest measurement whose reference is there.
/// What was lost is passed over, and the law told so (`LawStepper`); never silently: gaps are
/// counted, and reported at the end. Errors: see `run_node`.
void run_realtime(const experiment::Scenario& scenario, ScenarioLaw law, bus::Transport& transport,
                  node::Session& session);

}  // namespace tachless::controller

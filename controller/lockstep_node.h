#pragma once

#include <filesystem>
#include <optional>

#include "bus/transport.h"
#include "controller/registry.h"
#include "experiment/scenario.h"
#include "node/session.h"

namespace tachless::controller {

/// The controller's loop in lockstep: every tick once, in order. Knows no law: LawOnBus does.
/// `resume`, errors: see `run_node`.
void run_lockstep(const experiment::Scenario& scenario, ScenarioLaw law, bus::Transport& transport,
                  node::Session& session, const std::optional<std::filesystem::path>& resume);

}  // namespace tachless::controller

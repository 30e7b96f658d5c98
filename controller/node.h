#pragma once

#include <filesystem>
#include <optional>

#include "controller/registry.h"
#include "experiment/scenario.h"
#include "node/session.h"

namespace tachless::controller {

/// The controller process: runs `law` over the run of `scenario`, one step per tick, on the
/// measurements of the channel that belongs to the law's measurement type and on no other.
/// `resume`: the log of a lockstep run under way, whose controller has died: the law's memory is
/// rebuilt from the inputs it holds, and the run goes on as if nothing had happened.
/// @throw diagnostics::Failure bad_usage (log), protocol_violated (two plants or
/// references), protective_stop (a torque that is not finite), and what the session throws.
void run_node(const experiment::Scenario& scenario, ScenarioLaw law, node::Session& session,
              const std::optional<std::filesystem::path>& resume = {});

}  // namespace tachless::controller

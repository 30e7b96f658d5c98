#pragma once

#include <functional>

#include "diagnostics/failure.h"
#include "experiment/scenario.h"
#include "node/link.h"
#include "node/options.h"

namespace tachless::node {

/// What one role does in a run.
using RoleMain = std::function<void(const experiment::Scenario&, Link&)>;

/// The life of one of the four processes: loads the scenario, catches interruptions, opens the bus,
/// runs the role, writes the statistics (in every case, when asked for). Knows no role's work.
/// @throw Failure for everything that ends the role early, and for the fault that the role has
/// noted in its statistics though it came to its end.
diagnostics::ExitCode run_role(loop::Role role, const ProcessOptions& options,
                               const RoleMain& main);

}  // namespace tachless::node

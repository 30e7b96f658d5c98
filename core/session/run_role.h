#pragma once

#include <functional>

#include "base/failure.h"
#include "scenario/scenario.h"
#include "session/options.h"
#include "session/session.h"

namespace tachless::session {

/// Work of one role in a run.
using RoleMain = std::function<void(const scenario::Scenario&, Session&)>;

/// Runs one of the four processes. It loads the scenario, catches interruptions, opens the bus, and
/// runs the role. If statistics are requested, it writes them in every case.
/// @throw Failure for every early end of the role, and for a fault in the statistics of a role that
/// ended regularly.
base::ExitCode run_role(messages::Role role, const ProcessOptions& options, const RoleMain& main);

}  // namespace tachless::session

#pragma once

#include <functional>

#include "base/failure.h"
#include "scenario/scenario.h"
#include "session/options.h"
#include "session/session.h"

namespace tachless::session {

/// What one role does in a run.
using RoleMain = std::function<void(const scenario::Scenario&, Session&)>;

/// The life of one of the four processes: loads the scenario, catches interruptions, opens the bus,
/// runs the role, writes the statistics (in every case, when asked for). Knows no role's work.
/// @throw Failure for everything that ends the role early, and for the fault that the role has
/// noted in its statistics though it came to its end.
base::ExitCode run_role(messages::Role role, const ProcessOptions& options, const RoleMain& main);

}  // namespace tachless::session

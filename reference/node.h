#pragma once

#include "scenario/scenario.h"
#include "session/session.h"

namespace tachless::reference {

/// Runs the reference process: answers TICK(k) with the reference of k + 1, one tick ahead, until
/// the plant has finished.
/// @throw base::Failure: bad_usage (scenario), protocol_violated (two plants), protective_stop (a
/// reference that is not finite), and the failures of the session.
void run_node(const scenario::Scenario& scenario, session::Session& session);

}  // namespace tachless::reference

#pragma once

#include "bus/transport.h"
#include "experiment/scenario.h"
#include "node/session.h"

namespace tachless::reference {

/// The reference process: answers TICK(k) with the reference of k + 1, one tick ahead, until the
/// plant has finished.
/// @throw diagnostics::Failure bad_usage (scenario), protocol_violated (two plants),
/// protective_stop (a reference that is not finite), and whatever the session says.
void run_node(const experiment::Scenario& scenario, bus::Transport& transport,
              node::Session& session);

}  // namespace tachless::reference

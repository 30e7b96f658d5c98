#pragma once

#include "app/scenario.h"
#include "app/session.h"
#include "bus/transport.h"

namespace reference {

/// The reference process: answers TICK(k) with the reference of k + 1, one tick ahead, until the
/// plant has finished.
/// @throw app::Failure bad_usage (scenario), protocol_violated (two plants), protective_stop (a
/// reference that is not finite), and whatever the session says.
void run_node(const app::Scenario& scenario, bus::Transport& transport, app::Session& session);

}  // namespace reference

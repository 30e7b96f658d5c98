#pragma once

#include "app/scenario.h"
#include "app/session.h"
#include "bus/transport.h"

namespace plant {

/// The plant process: the emulated robot and the loop's clock. Publishes what the controller
/// measures, the TRUTH for the logger and RUN_INFO; advances with the commands that come back.
/// @throw app::Failure bad_usage (scenario), peer_lost (nobody answers), protocol_violated (two
/// processes command), protective_stop (the simulation diverged), and whatever the session says.
void run_node(const app::Scenario& scenario, bus::Transport& transport, app::Session& session);

}  // namespace plant

#pragma once

#include <filesystem>

#include "app/scenario.h"
#include "app/session.h"
#include "bus/transport.h"

namespace logger {

/// The logger process: records RUN_INFO and then, tick by tick and without a gap, TICK,
/// measurement, REFERENCE, COMMAND, CONTROLLER_STATE and TRUTH, each once, stamped with simulation
/// time. Heartbeats stay out, so a lockstep log is a function of scenario and run id.
/// @throw app::Failure bad_usage (log file), protocol_violated (two senders of one message), the
/// disk's refusal, and whatever the session says. The log is closed and readable in each case.
void run_node(const app::Scenario& scenario, bus::Transport& transport, app::Session& session,
              const std::filesystem::path& log_path);

}  // namespace logger

#pragma once

#include <filesystem>

#include "scenario/scenario.h"
#include "session/session.h"

namespace tachless::logger {

/// Runs the logger process. It records RUN_INFO and then, tick by tick and without a gap, the six
/// messages of each tick. These are TICK, measurement, REFERENCE, COMMAND, CONTROLLER_STATE and
/// TRUTH, each once, stamped with simulation time. In lockstep periodic announcements are not
/// recorded, so the log is a function of scenario and run id. The log of a failed run ends with the
/// announcement of the fault. The log is closed and readable in each case.
/// @throw base::Failure bad_usage (log file), protocol_violated (two senders of one message), a log
/// that cannot be written, and the failures of the session.
void run_node(const scenario::Scenario& scenario, session::Session& session,
              const std::filesystem::path& log_path);

}  // namespace tachless::logger

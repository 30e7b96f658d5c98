#pragma once

#include <functional>

#include "bus/transport.h"
#include "bus/wire.h"
#include "diagnostics/failure.h"
#include "experiment/scenario.h"
#include "node/process_options.h"
#include "node/session.h"

namespace tachless::node {

/// What one role does in a run.
using Part = std::function<void(const experiment::Scenario&, bus::Transport&, Session&)>;

/// The life of one of the four processes: loads the scenario, catches interruptions, joins the
/// bus, plays the part, writes the statistics (in every case, when asked for).
/// @throw Failure for everything that ends the part early.
diagnostics::ExitCode run_role(loop::Role role, const ProcessOptions& options, const Part& part);

}  // namespace tachless::node

#pragma once

#include <functional>

#include "app/exit_code.h"
#include "app/process_options.h"
#include "app/scenario.h"
#include "app/session.h"
#include "bus/transport.h"
#include "bus/wire.h"

namespace app {

/// What one role does in a run.
using Part = std::function<void(const Scenario&, bus::Transport&, Session&)>;

/// The life of one of the four processes: loads the scenario, catches interruptions, joins the
/// bus, plays the part, writes the statistics (in every case, when asked for).
/// @throw Failure for everything that ends the part early.
ExitCode take_part(bus::Role role, const ProcessOptions& options, const Part& part);

}  // namespace app

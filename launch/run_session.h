#pragma once

#include "diagnostics/failure.h"
#include "launch/run_plan.h"

namespace tachless::launch {

/// `tachless run`: runs a scenario to its end, in four processes or in this one, shows how far it
/// is, and writes log, summary, figure and report. Returns the run's exit code (see supervise.h).
/// @throw diagnostics::Failure for what is refused before anything is started
diagnostics::ExitCode run_session(RunOptions options);

}  // namespace tachless::launch

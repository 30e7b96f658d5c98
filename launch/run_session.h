#pragma once

#include "diagnostics/failure.h"
#include "launch/run_plan.h"

namespace tachless::launch {

/// `tachless run`: runs the four processes of a scenario to their end, shows how far they are, and
/// writes log, summary, figure and report. Returns the run's exit code (see supervise.h).
/// @throw diagnostics::Failure for what is refused before anything is started
diagnostics::ExitCode run_session(RunOptions options);

}  // namespace tachless::launch

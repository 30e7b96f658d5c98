#pragma once

#include "diagnostics/failure.h"
#include "launch/run_plan.h"

namespace tachless::launch {

/// `tachless run`: runs one scenario or several at once to their end, each in four processes of its
/// own on one bus or, one after another, in this one; shows how far they are, and writes log,
/// summary, figure and report of each. When one fails, the others are interrupted, or not begun.
/// @param options of all of them; without scenario and robot  @param scenarios at least one
/// @return the exit code (see supervise.h) of the first that did not end well, by itself before
/// because of another
/// @throw diagnostics::Failure for what is refused before anything is started
diagnostics::ExitCode run_session(RunOptions options,
                                  const std::vector<std::filesystem::path>& scenarios);

}  // namespace tachless::launch

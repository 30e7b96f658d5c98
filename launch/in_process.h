#pragma once

#include <filesystem>

#include "experiment/scenario.h"
#include "launch/run_results.h"
#include "launch/screen.h"

namespace tachless::launch {

/// Runs a lockstep scenario in this process, without a bus, to its end, a fault or an interruption
/// by the user, and writes the log that four processes write, to the last bit. That of a run that
/// has failed ends with an announcement of the fault in the plant's name.
RunEnd run_in_this_process(const experiment::Scenario& scenario, const RunOptions& options,
                           const std::filesystem::path& log, Screen& screen);

}  // namespace tachless::launch

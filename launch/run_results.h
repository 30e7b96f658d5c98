/// What a run leaves behind: its log, read back, and the summary, figure and report drawn from it.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "diagnostics/failure.h"
#include "experiment/scenario.h"
#include "launch/run_plan.h"
#include "node/statistics.h"
#include "report/summary.h"

namespace tachless::launch {

/// How a run ended, before its log is read.
struct RunEnd {
  diagnostics::ExitCode code = diagnostics::ExitCode::done;
  std::optional<std::string> fault;  ///< the first cause
  double wall_s = 0;
  std::vector<node::Statistics> statistics;  ///< of the processes that left theirs
  std::string placement;                     ///< of the processes on CPUs, for people
};

/// What has become of a run.
struct Concluded {
  diagnostics::ExitCode code = diagnostics::ExitCode::done;
  std::string row;  ///< of the table of several runs
};

/// Reads the log back, tells the first cause and, by `tell_others`, what came of it, writes
/// summary, figure and report, and for people the closing table. Of a run that has not begun there
/// are neither files nor table.
Concluded conclude(const experiment::Scenario& scenario, const RunOptions& options,
                   RunDirectory& out, const RunEnd& end, const std::function<void()>& tell_others);

}  // namespace tachless::launch

/// What a run leaves behind: its log, read back, and the summary, figure and report drawn from it.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "diagnostics/failure.h"
#include "experiment/scenario.h"
#include "launch/run_plan.h"
#include "node/statistics.h"
#include "report/log_tracking.h"
#include "report/summary.h"

namespace tachless::launch {

/// How a run ended, before its log is read.
struct RunEnd {
  diagnostics::ExitCode code = diagnostics::ExitCode::done;
  std::optional<std::string> fault;  ///< the first cause
  double wall_s = 0;
  std::vector<node::Statistics> statistics;  ///< of the processes that left theirs
};

/// The log of a run, read back.
struct ReadBack {
  explicit ReadBack(int num_joints) : tracking(num_joints) {}

  study::Tracking tracking;
  std::int64_t ticks = 0;
  std::int64_t gaps = 0;
  bool damaged = false;
  std::string problem;  ///< why it cannot be read; empty: it can
};

ReadBack read_back(const experiment::Scenario& scenario, const std::string& path, std::int64_t run);

/// What is wrong with the log of a run of which every program says that it ended well; empty:
/// nothing. In realtime ticks may be missing, which the logger then has said.
std::string log_problem(const ReadBack& log, const experiment::Scenario& scenario,
                        const std::string& path);

/// Reads the log back, tells the first cause and, by `tell_others`, what came of it, writes
/// summary, figure and report, and for people the closing table. Of a run that has not begun there
/// are neither files nor table. Returns the run's exit code.
diagnostics::ExitCode conclude(const experiment::Scenario& scenario, const RunOptions& options,
                               RunDirectory& out, const RunEnd& end,
                               const std::function<void()>& tell_others);

}  // namespace tachless::launch

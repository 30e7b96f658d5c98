/// What a run leaves behind: its log, read back, and the summary, figure and report drawn from it.
#pragma once

#include <cstdint>
#include <string>

#include "diagnostics/failure.h"
#include "experiment/scenario.h"
#include "launch/run_plan.h"
#include "report/log_tracking.h"
#include "report/summary.h"

namespace tachless::launch {

/// The log of a run, read back.
struct ReadBack {
  explicit ReadBack(int num_joints) : tracking(num_joints) {}

  report::Tracking tracking;
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

/// Writes summary, figure and report of the log that was read back, and for people the closing
/// table. Of a run that has not begun there are neither files nor table. Tells what cannot be
/// written, and returns its exit code.
diagnostics::ExitCode write_results(const experiment::Scenario& scenario, const RunOptions& options,
                                    const RunDirectory& out, const report::RunSummary& summary);

}  // namespace tachless::launch

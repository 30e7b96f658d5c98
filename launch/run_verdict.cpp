#include "launch/run_verdict.h"

#include "certificate/feasibility.h"
#include "certificate/verdict.h"
#include "diagnostics/logging.h"

namespace tachless::launch {

RunVerdict judge(const experiment::Scenario& scenario, const RunOptions& options) {
  const certificate::Verdict loop = certificate::verdict(scenario);
  const bool unstable = loop.known && !loop.stable;
  if (unstable && !options.force) {
    throw diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                               certificate::refusal(loop, options.scenario.string()));
  }
  const certificate::Feasibility feasibility = certificate::feasibility(scenario);
  RunVerdict verdict{certificate::text(loop), unstable, feasibility.impossible};
  verdict.warnings.insert(verdict.warnings.end(), feasibility.doubtful.begin(),
                          feasibility.doubtful.end());
  return verdict;
}

void say(const RunVerdict& verdict, bool quiet) {
  if (verdict.warns) {
    diagnostics::log_warning(verdict.line);
  } else if (!quiet) {
    diagnostics::log_info(verdict.line);
  }
  for (const std::string& warning : verdict.warnings) diagnostics::log_warning(warning);
}

}  // namespace tachless::launch

#include "launch/run_verdict.h"

#include "certificate/feasibility.h"
#include "certificate/verdict.h"
#include "diagnostics/logging.h"

namespace tachless::launch {

void say_verdict(const experiment::Scenario& scenario, const RunOptions& options) {
  const certificate::Feasibility feasibility = certificate::feasibility(scenario);
  for (const std::string& problem : feasibility.impossible) diagnostics::log_warning(problem);
  for (const std::string& doubt : feasibility.doubtful) diagnostics::log_warning(doubt);
  const certificate::Verdict verdict = certificate::verdict(scenario);
  if (verdict.known && !verdict.stable) {
    if (!options.force) {
      throw diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                                 certificate::refusal(verdict, options.scenario.string()));
    }
    diagnostics::log_warning(certificate::text(verdict));
  } else if (!options.quiet) {
    diagnostics::log_info(certificate::text(verdict));
  }
}

}  // namespace tachless::launch

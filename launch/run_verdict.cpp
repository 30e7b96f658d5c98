#include "launch/run_verdict.h"

#include <fmt/core.h>

#include "certificate/feasibility.h"
#include "certificate/verdict.h"
#include "diagnostics/logging.h"

namespace tachless::launch {
namespace {

std::string friction_text(const experiment::Scenario& scenario) {
  const robot::Model& model = *scenario.model;
  if (scenario.gives("plant.drive.viscous_friction_Nms_per_rad") ||
      (model.damping.isZero(0) && model.friction.isZero(0))) {
    return "";
  }
  return fmt::format("viscous friction as the URDF's <dynamics damping>{}",
                     model.friction.isZero(0) ? "" : "; its <dynamics friction> is not modelled");
}

}  // namespace

RunVerdict judge(const experiment::Scenario& scenario, const RunOptions& options) {
  const certificate::Verdict loop = certificate::verdict(scenario);
  const bool unstable = loop.unknown.empty() && !loop.stable;
  if (unstable && !options.force) {
    throw diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                               certificate::refusal(loop, options.scenario.string()));
  }
  const certificate::Feasibility feasibility = certificate::feasibility(scenario);
  RunVerdict verdict{certificate::text(loop), unstable, friction_text(scenario),
                     scenario.model->warnings};
  verdict.warnings.insert(verdict.warnings.end(), feasibility.impossible.begin(),
                          feasibility.impossible.end());
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
  if (!quiet && !verdict.friction.empty()) diagnostics::log_info(verdict.friction);
  for (const std::string& warning : verdict.warnings) diagnostics::log_warning(warning);
}

}  // namespace tachless::launch

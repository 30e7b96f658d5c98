#include "launch/run_verdict.h"

#include <fmt/core.h>

#include "certificate/feasibility.h"
#include "certificate/sampled_certificate.h"
#include "diagnostics/logging.h"

namespace tachless::launch {
namespace {

std::string friction_text(const experiment::Scenario& scenario) {
  const robot::Model& model = *scenario.model;
  std::string text;
  const auto add = [&](const char* key, const robot::Vector& of_urdf, const char* what) {
    if (of_urdf.isZero(0) || scenario.gives(key)) return;
    text += fmt::format("{}{}", text.empty() ? "" : ", ", what);
  };
  add("plant.drive.viscous_friction_Nms_per_rad", model.damping,
      "viscous friction as the URDF's <dynamics damping>");
  add("plant.drive.coulomb_friction_Nm", model.friction,
      "Coulomb friction as the URDF's <dynamics friction>");
  return text;
}

}  // namespace

RunVerdict judge(const experiment::Scenario& scenario, const RunOptions& options) {
  const certificate::Verdict loop = certificate::verdict(scenario);
  const bool unstable = loop.unknown.empty() && !loop.stable;
  if (unstable && !options.force) {
    throw diagnostics::bad_usage(certificate::refusal(loop, options.scenario.string()));
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

void say(const RunVerdict& verdict, const RunOptions& options) {
  const auto warn = [&](const std::string& line) { diagnostics::log_warning(options.named(line)); };
  const auto inform = [&](const std::string& line) {
    if (!options.quiet && !line.empty()) diagnostics::log_info(options.named(line));
  };
  verdict.warns ? warn(verdict.line) : inform(verdict.line);
  inform(verdict.friction);
  for (const std::string& warning : verdict.warnings) warn(warning);
}

}  // namespace tachless::launch

#include "launch/laws_of.h"

#include <fmt/format.h>

#include <stdexcept>

#include "certificate/scenario_loop.h"
#include "controller/registry.h"
#include "diagnostics/failure.h"

namespace tachless::launch {

std::vector<std::string> laws_of(const experiment::Scenario& scenario,
                                 const std::vector<std::string>& names) {
  std::vector<std::string> result;
  const bool flexible = scenario.robot.flexible.has_value();
  const bool moves = certificate::ScenarioLoop(scenario).moves();
  for (const std::string& name : names) {
    if (name != "all") {
      try {
        result.emplace_back(controller::law_facts(name).name);
      } catch (const std::invalid_argument& problem) {
        throw diagnostics::bad_usage("--laws: {}", problem.what());
      }
      continue;
    }
    for (const controller::LawFacts& law : controller::laws()) {
      if (law.needs_flexible_joints != flexible || (law.regulation_only && moves)) continue;
      result.emplace_back(law.name);
    }
  }
  return result;
}

}  // namespace tachless::launch

#pragma once

#include <string>
#include <vector>

#include "experiment/scenario.h"
#include "launch/run_plan.h"

namespace tachless::launch {

/// What is said of a run before it starts.
struct RunVerdict {
  std::string line;  ///< whether the linearised loop is stable at its rate
  bool warns = false;
  std::string friction;  ///< where the plant has its friction from, if from the URDF
  /// What the URDF has that is not as it should be, and what the reference asks in vain of drives
  /// and joints.
  std::vector<std::string> warnings;
};

/// @throw diagnostics::Failure(bad_usage) for an unstable loop without --force
RunVerdict judge(const experiment::Scenario& scenario, const RunOptions& options);

/// On stderr; with --quiet the warnings alone.
void say(const RunVerdict& verdict, const RunOptions& options);

}  // namespace tachless::launch

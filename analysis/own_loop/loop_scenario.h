#pragma once

#include <string>
#include <vector>

#include "own_loop/own_loop.h"
#include "scenario/scenario.h"

/// Scenario of a control loop in the caller's own program. It may lack the parts that only a
/// simulated run needs.
namespace tachless::own_loop {

/// Scenario of a loop, and whether the scenario gives its reference.
struct LoopScenario {
  scenario::Scenario scenario;  ///< scenario, with a constant reference if none is given
  bool has_reference = false;   ///< the file or an override gives one
};

/// Reads a scenario's file. The parts that a law does not need may be missing: the reference, the
/// initial position and the duration. A given duration need not be a whole number of periods.
/// @throw base::Failure(bad_usage) as `scenario::load_scenario`
LoopScenario read_loop_scenario(const std::string& file, const std::vector<std::string>& set);

/// Makes the scenario of a law for a robot's file, without a reference.
/// @throw base::Failure(bad_usage) if a setting is refused or the file describes no robot
LoopScenario make_loop_scenario(const LawSettings& law, const std::vector<std::string>& set);

}  // namespace tachless::own_loop

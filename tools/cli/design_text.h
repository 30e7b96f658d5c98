#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "design/design.h"
#include "design/structure.h"
#include "scenario/scenario.h"

/// Output of `tachless design`, for people and as JSON.
namespace tachless::cli {

std::string design_text(const design::Design& design, const scenario::Scenario& scenario);
nlohmann::ordered_json design_json(const design::Design& design,
                                   const scenario::Scenario& scenario);

/// Returns one table of the structures, and one of their joints with the stiffness that the arm's
/// maker publishes.
std::string comparison_text(const design::Comparison& comparison);
nlohmann::ordered_json comparison_json(const design::Comparison& comparison);

/// Returns the assumptions as lines: the first begins with "assumes".
std::string assumptions_text(const std::vector<std::string>& assumed);

/// Returns an option such as "--set 'robot.locked={finger_joint1: 0.02}'", which holds the joints
/// that are fingers in the middle of their ranges; empty: there are none. A finger is a prismatic
/// joint with a range below 0.1 m, or a joint with the word in its name.
std::string finger_lock(const robot::Model& model);

/// Returns options to type that allow stiffer gains or make the arm lighter.
std::string ways_out(const scenario::Scenario& scenario);

}  // namespace tachless::cli

#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "experiment/scenario.h"
#include "experiment/yaml_tree.h"

/// The table of `reference: {file: …}`.
namespace tachless::experiment {

/// The table's text where the tree names one, whose digest goes into the tree; empty otherwise.
/// @param scenario for complaints @param directory of the scenario
/// @throw Failure(bad_usage) when it cannot be read or is not the one whose digest the tree has
std::string motion_text(YamlNode& root, const Scenario& scenario,
                        const std::filesystem::path& directory);

/// Gives the scenario the motion of the table's text, where it names one.
/// @throw Failure(bad_usage) as `parse_motion`
void attach_motion(Scenario& scenario, const std::string& text,
                   const std::filesystem::path& directory);

/// The same for a scenario that was parsed from text: reads the table it names.
/// @throw Failure(bad_usage) as `motion_text` and `parse_motion`
void read_motion(Scenario& scenario, const std::filesystem::path& directory);

/// A spline through the rows of a table (docs/trajectories.md).
/// @param source the file's name @throw std::invalid_argument, one line "source:line: …", for what
/// is no number, times that do not increase, columns that are not the joints, and positions or
/// speeds beyond the model's limits
reference::trajectory::WaypointSpline parse_motion(std::string_view text, const std::string& source,
                                                   const robot::Model& model);

}  // namespace tachless::experiment

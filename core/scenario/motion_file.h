#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "scenario/scenario.h"
#include "scenario/yaml_tree.h"

/// The table of `reference: {file: …}`.
namespace tachless::scenario {

/// Writes the digest of the table that the tree names into the tree, if the tree has none.
/// @param scenario for complaints
/// @param directory of the scenario
/// @throw Failure(bad_usage) when the table cannot be read
void pin_motion(YamlNode& root, const Scenario& scenario, const std::filesystem::path& directory);

/// Gives the scenario the motion of the table that it names, if any. Adds a warning to the model if
/// the run has only a part of the motion.
/// @throw Failure(bad_usage) when the table cannot be read or has another digest, when its times
/// lie outside the run, and as `parse_motion`
void read_motion(Scenario& scenario, const std::filesystem::path& directory);

/// Returns a spline through the rows of a table (docs/trajectories.md).
/// @param source the file's name
/// @param file which column is the time, and its unit
/// @throw std::invalid_argument "source:line: …" for a field that is no number, times that do not
/// increase, missing columns, and positions or speeds beyond the model's limits
reference::trajectory::WaypointSpline parse_motion(
    std::string_view text, const std::string& source, const robot::Model& model,
    const reference::trajectory::MotionFile& file = {});

}  // namespace tachless::scenario

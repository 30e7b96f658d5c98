#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "base/failure.h"
#include "scenario/scenario.h"

namespace tachless::cli {

/// Reads a file that is a MuJoCo model (MJCF); returns nothing for another file.
/// @throw base::Failure(bad_usage) as `scenario::robot_file`
std::optional<scenario::RobotFile> mjcf_file(const std::filesystem::path& file,
                                             const std::vector<std::string>& overrides);

/// Prints the steps up to which the position actuators of a MuJoCo model are stable.
/// @param model of the file, as `mjcf_file` returns it
/// @param step_s step that is judged [s]; 0: the model's timestep
/// @return done if the model's integrator is stable at that step, else check_said_no
/// @throw base::Failure(bad_usage) for a model without such actuators
base::ExitCode check_mjcf_gains(const std::filesystem::path& file, const scenario::RobotFile& model,
                                double step_s, bool json);

}  // namespace tachless::cli

#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "base/failure.h"

namespace tachless::cli {

/// Returns whether a file is a MuJoCo model (MJCF).
bool is_mjcf_file(const std::filesystem::path& file);

/// Prints the steps up to which the position actuators of a MuJoCo model are stable.
/// @param step_s step that is judged [s]; 0: the model's timestep
/// @return done if the model's integrator is stable at that step, else check_said_no
/// @throw base::Failure(bad_usage) for a model without such actuators
base::ExitCode check_mjcf_gains(const std::filesystem::path& file,
                                const std::vector<std::string>& overrides, double step_s,
                                bool json);

}  // namespace tachless::cli

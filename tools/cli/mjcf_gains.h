#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "base/failure.h"

namespace tachless::cli {

/// Returns the text of a file that is a MuJoCo model (MJCF); nothing for another file.
std::optional<std::string> mjcf_text(const std::filesystem::path& file);

/// Prints the steps up to which the position actuators of a MuJoCo model are stable.
/// @param text of the file, as of `mjcf_text`
/// @param step_s step that is judged [s]; 0: the model's timestep
/// @return done if the model's integrator is stable at that step, else check_said_no
/// @throw base::Failure(bad_usage) for a model without such actuators
base::ExitCode check_mjcf_gains(const std::filesystem::path& file, const std::string& text,
                                const std::vector<std::string>& overrides, double step_s,
                                bool json);

}  // namespace tachless::cli

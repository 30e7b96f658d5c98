#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "robot/mjcf.h"

namespace tachless::scenario {

/// Reads the file of a robot: a URDF, a file that ends in .xacro (`urdf_text`), or a MuJoCo model.
/// A MuJoCo model has the root element <mujoco>; its included files are relative to it.
/// @throw Failure(bad_usage), one line, for a file that cannot be read, and for an MJCF as
/// `robot::description_of_mjcf`. The text of a URDF is not checked.
robot::Description read_description(const std::filesystem::path& file,
                                    const std::map<std::string, std::string>& xacro_arguments);

/// Returns the reader of the files that an MJCF includes, which are relative to it.
robot::IncludedText files_beside(const std::filesystem::path& mjcf);

}  // namespace tachless::scenario

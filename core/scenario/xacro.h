#pragma once

#include <chrono>
#include <filesystem>
#include <map>
#include <string>

namespace tachless::scenario {

/// Returns the text of a file. A file that ends in .xacro is processed by the program `xacro` of
/// the search path with these arguments. No shell reads them.
/// @throw Failure(bad_usage), one line, if there is no file or program, or if xacro fails, writes
/// more than a URDF may have, or takes longer than `xacro_patience`.
std::string urdf_text(const std::filesystem::path& file,
                      const std::map<std::string, std::string>& arguments);
inline constexpr std::chrono::seconds xacro_patience{30};

}  // namespace tachless::scenario

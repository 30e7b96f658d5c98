#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <string_view>

/// How a URDF's links look, for a page that draws them. No log has that.
namespace tachless::report {

struct Visuals {
  std::string urdf;                           ///< its text; empty: simple shapes are drawn
  std::map<std::string, std::string> meshes;  ///< base64 by the name in the URDF
};

std::string base64(std::string_view bytes);

/// Of a URDF that the user named; never of one from a bus or a log, whose names another has chosen.
/// Meshes: relative to its directory, file:// and package://, whose package is sought in the
/// directories above. Left out: other kinds, what is not there or no regular file, and what would
/// make more than 16 MB.
Visuals read_visuals(std::string urdf, const std::filesystem::path& directory);

}  // namespace tachless::report

#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <string_view>

/// Shapes of a URDF's links for a page that draws them. A log does not contain them.
namespace tachless::report {

struct Visuals {
  std::string urdf;                           ///< text of the URDF; empty: simple shapes are drawn
  std::map<std::string, std::string> meshes;  ///< base64 by the name in the URDF
};

std::string base64(std::string_view bytes);

/// Reads the meshes of a URDF that the user has named. Never call it for a URDF from a bus or a
/// log, because a stranger chose the names in it. Names are relative to the directory, file:// or
/// package://. Packages are searched in the parent directories. Leaves out other kinds of files,
/// links that lead out of the folder or package, and meshes beyond 16 MB or 500,000 faces in total.
Visuals read_visuals(std::string urdf, const std::filesystem::path& directory);

}  // namespace tachless::report

#pragma once

#include <filesystem>

/// Where the files of this installation are: a prefix with bin/ and share/tachless/, as
/// cmake/Install.cmake lays it out; a build directory looks the same.
namespace tachless::process {

/// Of this program and the others: bin/.
std::filesystem::path program_directory();

/// Of scenarios/, templates and tachless_types.jar: share/tachless/ beside bin/. In a build
/// directory also of the script that builds and tests the tree.
std::filesystem::path shared_directory();

}  // namespace tachless::process

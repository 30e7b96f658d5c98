#pragma once

#include <filesystem>

namespace tachless::logger {

/// The log that `path` means: itself, or, where it is the directory of a run, the `lcmlog` in it,
/// or, where it is the directory of several runs (out/NAME), that of the newest.
std::filesystem::path find_log(const std::filesystem::path& path);

}  // namespace tachless::logger

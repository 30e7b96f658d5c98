#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>

namespace tachless::diagnostics {

/// All that is in the file, to the byte; nothing when it cannot be opened or is a directory (errno
/// then says why it cannot be opened).
std::optional<std::string> file_text(const std::filesystem::path& path);

/// The same of a file that a user has named. `max_bytes`: 0 is no limit.
/// @throw Failure(bad_usage) with the file's name and why it cannot be read
std::string given_text(const std::filesystem::path& path, std::size_t max_bytes = 0);

}  // namespace tachless::diagnostics

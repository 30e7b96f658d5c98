#pragma once

#include <filesystem>
#include <optional>
#include <string>

namespace tachless::diagnostics {

/// All that is in the file, to the byte; nothing when it cannot be opened or is a directory (errno
/// then says why it cannot be opened).
std::optional<std::string> file_text(const std::filesystem::path& path);

}  // namespace tachless::diagnostics

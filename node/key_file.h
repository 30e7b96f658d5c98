#pragma once

#include <filesystem>

#include "bus/key.h"

namespace tachless::node {

/// The key in `path`: 32 bytes, or 64 hexadecimal digits with or without an end of line. This
/// process's memory is private from then on (process/private_memory.h).
/// @throw Failure(bad_usage) naming the path, never its content: not a readable regular file,
/// another length, readable by others than its owner, nothing but zeros.
bus::Key read_key_file(const std::filesystem::path& path);

}  // namespace tachless::node

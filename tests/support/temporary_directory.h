#pragma once

#include <filesystem>
#include <string_view>

#include "base/file_text.h"

/// Temporary directory with a short way to name its files.
class TemporaryDirectory : public tachless::base::TemporaryDirectory {
 public:
  using tachless::base::TemporaryDirectory::TemporaryDirectory;
  [[nodiscard]] std::filesystem::path operator/(std::string_view name) const {
    return path() / name;
  }
};

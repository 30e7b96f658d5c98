#pragma once

#include <filesystem>
#include <string_view>

#include "base/file_text.h"

/// With a shorter way to name what is in it.
class TemporaryDirectory : public tachless::base::TemporaryDirectory {
 public:
  using tachless::base::TemporaryDirectory::TemporaryDirectory;
  [[nodiscard]] std::filesystem::path operator/(std::string_view name) const {
    return path() / name;
  }
};

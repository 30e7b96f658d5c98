#include "diagnostics/file_text.h"

#include <fstream>
#include <iterator>

namespace tachless::diagnostics {

std::optional<std::string> file_text(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file || std::filesystem::is_directory(path)) return {};
  return std::string(std::istreambuf_iterator<char>(file), {});
}

}  // namespace tachless::diagnostics

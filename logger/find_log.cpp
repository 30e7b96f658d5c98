#include "logger/find_log.h"

#include <system_error>

namespace tachless::logger {

namespace fs = std::filesystem;

fs::path find_log(const fs::path& path) {
  std::error_code error;
  if (!fs::is_directory(path, error)) return path;
  const fs::path latest = fs::read_symlink(path / "latest", error);
  if (!error && fs::exists(path / latest / "lcmlog", error)) return path / latest / "lcmlog";
  fs::path newest = path;  // runs are named by their time
  if (!fs::exists(path / "lcmlog", error)) {
    for (const auto& entry : fs::directory_iterator(path, error)) {
      const bool run = !entry.is_symlink(error) && fs::exists(entry.path() / "lcmlog", error);
      if (run && (newest == path || entry.path() > newest)) newest = entry.path();
    }
  }
  return newest / "lcmlog";
}

}  // namespace tachless::logger

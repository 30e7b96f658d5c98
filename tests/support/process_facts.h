#pragma once

#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <system_error>
#include <vector>

/// What /proc tells of a process, beyond what the programs themselves want to know.
namespace tachless::support {

/// File name of the program that it runs ("tachless-plant"); empty when it is gone.
inline std::string program_of(pid_t pid) {
  std::error_code gone;
  const std::filesystem::path link = "/proc/" + std::to_string(pid) + "/exe";
  return std::filesystem::read_symlink(link, gone).filename().string();
}

/// Processes that its main thread has started and not yet waited for; none when it is gone.
inline std::vector<pid_t> children_of(pid_t pid) {
  const std::string directory = "/proc/" + std::to_string(pid);
  std::ifstream file(directory + "/task/" + std::to_string(pid) + "/children");
  std::vector<pid_t> children;
  for (pid_t child = 0; file >> child;) children.push_back(child);
  return children;
}

/// Memory that it occupies [KiB]; nothing when it has ended.
inline std::optional<std::int64_t> resident_kib(pid_t pid) {
  std::ifstream file("/proc/" + std::to_string(pid) + "/status");
  for (std::string word; file >> word;) {
    if (word != "VmRSS:") continue;
    std::int64_t value = 0;
    file >> value;
    return value;
  }
  return std::nullopt;
}

}  // namespace tachless::support

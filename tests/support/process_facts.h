#pragma once

#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <system_error>
#include <vector>

/// Facts of a process from /proc, beyond those that the programs themselves read.
namespace tachless::support {

/// Returns the file name of the program of the process ("tachless-plant"); empty if the process has
/// ended.
inline std::string program_of(pid_t pid) {
  std::error_code gone;
  const std::filesystem::path link = "/proc/" + std::to_string(pid) + "/exe";
  return std::filesystem::read_symlink(link, gone).filename().string();
}

/// Returns the processes that its main thread has started and not yet waited for; empty if the
/// process has ended.
inline std::vector<pid_t> children_of(pid_t pid) {
  const std::string directory = "/proc/" + std::to_string(pid);
  std::ifstream file(directory + "/task/" + std::to_string(pid) + "/children");
  std::vector<pid_t> children;
  for (pid_t child = 0; file >> child;) children.push_back(child);
  return children;
}

/// Returns the resident memory of the process [KiB]; nullopt if the process has ended.
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

#include "process/process_tree.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>
#include <system_error>

namespace tachless::process {
namespace {

std::filesystem::path directory_of(pid_t pid) {
  return std::filesystem::path("/proc") / std::to_string(pid);
}

/// What is in a directory; nothing more from where it is gone.
std::vector<std::filesystem::path> entries_of(const std::filesystem::path& directory) {
  std::vector<std::filesystem::path> entries;
  std::error_code gone;
  for (std::filesystem::directory_iterator each(directory, gone), end; each != end;
       each.increment(gone)) {
    entries.push_back(each->path());
  }
  return entries;
}

}  // namespace

std::vector<pid_t> children_of(pid_t pid) {
  std::ifstream file(directory_of(pid) / "task" / std::to_string(pid) / "children");
  std::vector<pid_t> children;
  for (pid_t child = 0; file >> child;) children.push_back(child);
  return children;
}

std::vector<pid_t> threads_of(pid_t pid) {
  std::vector<pid_t> threads;
  for (const auto& each : entries_of(directory_of(pid) / "task")) {
    threads.push_back(static_cast<pid_t>(std::stol(each.filename().string())));
  }
  return threads;
}

bool has_socket(pid_t pid) {
  const auto descriptors = entries_of(directory_of(pid) / "fd");
  return std::any_of(descriptors.begin(), descriptors.end(), [](const auto& each) {
    std::error_code gone;
    return std::filesystem::read_symlink(each, gone).string().starts_with("socket:");
  });
}

std::string program_of(pid_t pid) {
  std::error_code gone;
  return std::filesystem::read_symlink(directory_of(pid) / "exe", gone).filename().string();
}

std::optional<std::int64_t> resident_kib(pid_t pid) {
  std::ifstream file(directory_of(pid) / "status");
  std::string word;
  while (file >> word) {
    if (word != "VmRSS:") continue;
    std::int64_t value = 0;
    file >> value;
    return value;
  }
  return std::nullopt;
}

}  // namespace tachless::process

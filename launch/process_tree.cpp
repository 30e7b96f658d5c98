#include "launch/process_tree.h"

#include <filesystem>
#include <fstream>
#include <string>
#include <system_error>

namespace launch {
namespace {

std::filesystem::path directory_of(pid_t pid) {
  return std::filesystem::path("/proc") / std::to_string(pid);
}

}  // namespace

std::vector<pid_t> children_of(pid_t pid) {
  std::ifstream file(directory_of(pid) / "task" / std::to_string(pid) / "children");
  std::vector<pid_t> children;
  for (pid_t child = 0; file >> child;) children.push_back(child);
  return children;
}

std::vector<pid_t> threads_of(pid_t pid) {
  namespace fs = std::filesystem;
  std::vector<pid_t> threads;
  std::error_code gone;
  for (fs::directory_iterator each(directory_of(pid) / "task", gone), end; each != end;
       each.increment(gone)) {
    threads.push_back(static_cast<pid_t>(std::stol(each->path().filename().string())));
  }
  return threads;
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

}  // namespace launch

#include "process/process_tree.h"

#include <sched.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>
#include <system_error>

namespace tachless::process {
namespace {

namespace fs = std::filesystem;

fs::path directory_of(pid_t pid) { return fs::path("/proc") / std::to_string(pid); }

/// What is in a directory; nothing more from where it is gone.
std::vector<fs::path> entries_of(const fs::path& directory) {
  std::vector<fs::path> entries;
  std::error_code gone;
  for (fs::directory_iterator each(directory, gone), end; each != end; each.increment(gone)) {
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

bool has_socket(pid_t pid) {
  return std::ranges::any_of(entries_of(directory_of(pid) / "fd"), [](const fs::path& each) {
    std::error_code gone;
    return fs::read_symlink(each, gone).string().starts_with("socket:");
  });
}

void set_idle_priority(pid_t pid) {
  const sched_param none{};
  for (const fs::path& thread : entries_of(directory_of(pid) / "task")) {
    [[maybe_unused]] const int refused =
        sched_setscheduler(std::stoi(thread.filename().string()), SCHED_IDLE, &none);
  }
}

}  // namespace tachless::process

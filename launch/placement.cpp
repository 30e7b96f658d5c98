#include "launch/placement.h"

#include <fmt/core.h>
#include <unistd.h>

#include "diagnostics/failure.h"
#include "process/this_process.h"

namespace tachless::launch {

using loop::Role;

Placement choose_placement(const std::string& wanted, experiment::Mode mode, std::size_t index) {
  if (wanted != "auto" && wanted != "none") {
    throw diagnostics::bad_usage(
        "--placement {}: allowed: auto, none; for other CPUs start the programs with taskset",
        wanted);
  }
  Placement placement;
  std::vector<int> cpus = process::allowed_cpus();
  if (wanted == "none" || mode == experiment::Mode::realtime || cpus.size() == 1) return placement;
  // At most one of the three computes at a time, and waking a process on another CPU takes longer
  // than on the same one. Runs side by side are distinguished by the launcher's process number.
  const int cpu = cpus[(static_cast<std::size_t>(getpid()) + index) % cpus.size()];
  for (const Role role : {Role::plant, Role::controller, Role::reference}) {
    placement.cpus[static_cast<std::size_t>(role)] = {cpu};
  }
  std::erase(cpus, cpu);
  placement.cpus[static_cast<std::size_t>(Role::logger)] = cpus;
  placement.words = fmt::format("together on CPU {}", cpu);
  return placement;
}

}  // namespace tachless::launch

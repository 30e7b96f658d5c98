#pragma once

#include <array>
#include <string>
#include <vector>

#include "experiment/scenario.h"
#include "loop/messages.h"

namespace tachless::launch {

/// On which CPUs the four processes of a run execute.
struct Placement {
  std::string words = "spread over CPUs";              ///< for people: "together on CPU 1"
  std::array<std::vector<int>, loop::num_roles> cpus;  ///< by role; empty: all that are allowed

  [[nodiscard]] const std::vector<int>& cpus_of(loop::Role role) const {
    return cpus[static_cast<std::size_t>(role)];
  }
};

/// `auto`: in lock-step plant, controller and reference on one CPU, the logger on the others; in
/// realtime, or with one CPU, as `none`. `none`: the kernel places them.
/// @param index of the robot among those of the run: each has another CPU, as far as there are any
/// @throw diagnostics::Failure(bad_usage) naming --placement and what is allowed
Placement choose_placement(const std::string& wanted, experiment::Mode mode, std::size_t index);

}  // namespace tachless::launch

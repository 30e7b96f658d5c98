#pragma once

#include <array>
#include <string>
#include <vector>

#include "experiment/scenario.h"
#include "loop/messages.h"
#include "process/file_descriptor.h"

namespace tachless::launch {

/// On which CPUs the four processes of a run execute.
struct Placement {
  std::string words;   ///< where they are, for people: "together on CPU 1"
  std::string reason;  ///< why, for people, or what was asked for
  std::array<std::vector<int>, loop::num_roles> cpus;  ///< by role; empty: all that are allowed
  /// Plant, controller and reference do not sleep while they wait for messages.
  bool spin = false;
  std::vector<process::FileDescriptor> claims;  ///< kept as long as the run

  [[nodiscard]] const std::vector<int>& cpus_of(loop::Role role) const {
    return cpus[static_cast<std::size_t>(role)];
  }
};

/// Chooses as `wanted` says:
/// - `spread`: the kernel places them, as without a launcher;
/// - `together`: plant, controller and reference on one CPU, of those that no other run has, if
///   there is one; the logger on the others;
/// - `spin`: these three on a CPU each, awake all the time;
/// - `auto`: in lockstep together where waking somebody on another CPU takes longer than what would
///   go on in parallel there, otherwise spread; in realtime spread;
/// - numbers: the CPU of all four; or that of the three and that of the logger; or those of plant,
///   controller, reference and logger.
/// @throw diagnostics::Failure(bad_usage) naming --placement and what is allowed
Placement choose_placement(const std::string& wanted, experiment::Mode mode);

}  // namespace tachless::launch

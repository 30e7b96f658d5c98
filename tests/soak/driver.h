#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "launch/supervise.h"
#include "tests/soak/observer.h"
#include "tests/soak/spec.h"

namespace tachless::soak {

/// What was seen of one run, for the judge.
struct Observation {
  launch::ProcessEnd end;  ///< of `tachless run`
  bool fault_made = false;
  bool overdue = false;  ///< it had to be interrupted, because it did not end
  double wall_s = 0;
  double end_s = 0;  ///< from a kill or Ctrl-C until the last of the four processes had ended
  std::int64_t hostile_datagrams = 0;
  std::map<std::string, Memory> memory;
};

inline constexpr std::chrono::seconds longest_round{600};

/// Makes the run of `spec` with its fault, and returns when it has ended. Judges nothing.
/// @throw diagnostics::Failure(interrupted) once `interrupted`, (bad_usage) when the network cannot
/// be made to lose packets
Observation drive(const Spec& spec, const std::atomic<bool>& interrupted);

/// Runs a command to its end. @return how it failed, if it did
/// @throw diagnostics::Failure(interrupted) when the user ends it
std::optional<std::string> failure_of(const std::vector<std::string>& command);

}  // namespace tachless::soak

#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>

#include "diagnostics/failure.h"

namespace tachless::soak {

struct Attacks {
  std::uint64_t first_seed = 1;
  std::int64_t rounds = 0;  ///< end after so many; 0: no limit
  double minutes = 0;       ///< begin rounds for so long; 0: no limit
  std::filesystem::path directory;
  bool quiet = false;
};

/// Plays rounds of the fault campaign with the four programs on the real bus, judges each by the
/// campaign's invariants, and keeps the files of those that break one. A table on stdout at the
/// end. Precondition: the process is in a network namespace of its own.
/// @return check_said_no when a round broke an invariant, interrupted when the user ended it
/// @throw diagnostics::Failure(bad_usage) when the directory cannot be written to or a program that
/// is needed is missing
diagnostics::ExitCode play_attacks(const Attacks& attacks, const std::atomic<bool>& interrupted);

}  // namespace tachless::soak

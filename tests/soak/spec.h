#pragma once

// What one run of a soak is started with. Nothing is started here.

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "experiment/scenario.h"
#include "tests/soak/plan.h"

namespace tachless::soak {

inline constexpr std::int64_t run_id = 7;

/// What all rounds have in common.
struct Setting {
  std::filesystem::path program;    ///< the `tachless` to run
  std::filesystem::path directory;  ///< where runs are written
  std::filesystem::path scenarios;
  std::int64_t num_ticks = 0;           ///< length of a lock-step run
  std::int64_t most_growth_kib = 1024;  ///< promised: of a process's resident memory
};

/// One run: a round with the scenario, the directory and the command that it is made with.
struct Spec {
  Round round;
  std::filesystem::path program;
  std::filesystem::path out;
  experiment::Scenario scenario;
  std::vector<std::string> command;
  std::int64_t most_growth_kib = 0;

  /// Whether the fault ends the run before its last tick.
  [[nodiscard]] bool ends_early() const {
    return round.fault == Fault::kill || round.fault == Fault::realtime_kill ||
           round.fault == Fault::interrupt;
  }
};

/// Creates `out`, empty, and writes the key that the round may need into it.
/// @throw diagnostics::Failure(bad_usage) when `out` cannot be written to
Spec specify(const Setting& setting, const Round& round, const std::filesystem::path& out);

/// @throw diagnostics::Failure(bad_usage) when it cannot be created or written to
void make_directory(const std::filesystem::path& path);

}  // namespace tachless::soak

#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "launch/soak_plan.h"

namespace tachless::launch {

/// Resident memory of one process in one round [KiB].
struct SoakMemory {
  std::int64_t early = 0;  ///< once a tenth of the run was over
  std::int64_t peak = 0;   ///< from then on
};

/// What became of a round.
struct SoakOutcome {
  std::vector<std::string> problems;  ///< what was guaranteed and did not hold; empty: all did
  double wall_s = 0;
  double end_s = 0;  ///< from a kill or Ctrl-C until the last of the four processes had ended
  std::int64_t hostile_datagrams = 0;
  std::map<std::string, SoakMemory> memory;  ///< by program
  nlohmann::json summary;                    ///< summary.json, null when there was none
};

/// Plays rounds: each a `tachless run`, and a `tachless replay` of its log. The clean run of a
/// scenario that the others are compared with is made when first needed. Processes that a run
/// leaves behind become this process's children from construction on. Precondition: the process is
/// in a network namespace of its own.
class SoakRunner {
 public:
  /// @param program the `tachless` to run
  /// @param directory where runs are written; what is in its subdirectories `soak-…` is replaced
  /// @param scenarios directory of this project's scenarios
  /// @param num_ticks length of a lock-step run
  /// @param interrupted set when the user wants it to end
  /// @throw diagnostics::Failure(bad_usage) when the directory or a program that is needed cannot
  /// be had
  SoakRunner(std::filesystem::path program, std::filesystem::path directory,
             std::filesystem::path scenarios, std::int64_t num_ticks,
             const std::atomic<bool>& interrupted);

  /// @throw diagnostics::Failure(interrupted) when the user ends it, (bad_usage) when the network
  /// cannot be made to lose packets
  SoakOutcome play(const SoakRound& round);

  /// Where the last round's files are. Replaced by the next.
  [[nodiscard]] std::filesystem::path last() const { return directory_ / "soak-round"; }
  /// Removes all that was written but what was kept.
  void clean_up();

 private:
  class Play;

  const std::atomic<bool>& interrupted_;
  std::filesystem::path program_;
  std::filesystem::path directory_;
  std::filesystem::path scenarios_;
  std::int64_t num_ticks_;
};

}  // namespace tachless::launch

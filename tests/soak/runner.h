#pragma once

#include <atomic>
#include <filesystem>

#include "tests/soak/driver.h"
#include "tests/soak/judge.h"
#include "tests/soak/plan.h"

namespace tachless::soak {

struct Outcome {
  Observation seen;
  Verdict verdict;
};

/// Makes rounds: each a `tachless run`, and a `tachless replay` of its log. The clean run of a
/// scenario, which the others are compared with, is made when it is first needed. Processes that a
/// run leaves behind become this process's children from construction on. It decides neither which
/// rounds there are nor what is kept of them. Precondition: the process is in a network namespace
/// of its own.
class Runner {
 public:
  /// @param setting what is in the subdirectories `soak-…` of its directory is replaced
  /// @param interrupted set when the user wants it to end
  /// @throw diagnostics::Failure(bad_usage) when the directory cannot be written to or a program
  /// that is needed is missing
  Runner(Setting setting, const std::atomic<bool>& interrupted);

  /// @throw diagnostics::Failure(interrupted) when the user ends it, (bad_usage) when the network
  /// cannot be made to lose packets
  Outcome run(const Round& round);

  /// Where the last round's files are. Replaced by the next.
  [[nodiscard]] std::filesystem::path last() const { return setting_.directory / "soak-round"; }
  /// Removes all that was written but what was kept.
  void clean_up();

 private:
  Outcome run(const Round& round, const std::filesystem::path& out,
              const std::optional<std::filesystem::path>& clean);

  Setting setting_;
  const std::atomic<bool>& interrupted_;
};

}  // namespace tachless::soak

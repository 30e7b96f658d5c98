#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "diagnostics/failure.h"
#include "launch/run.h"
#include "loop/messages.h"
#include "node/statistics.h"
#include "process/file_descriptor.h"
#include "report/summary.h"

/// What a run leaves behind: its directory, its log, read back, and the summary, figure and report
/// drawn from it.
namespace tachless::launch {

/// In the order in which their processes are started.
inline constexpr std::array roles = {loop::Role::logger, loop::Role::controller,
                                     loop::Role::reference, loop::Role::plant};

/// The run's directory, locked against a second run until destruction. The files of an earlier run
/// are set aside until this run has begun: if it does not, they are there again afterwards, else
/// its log is `lcmlog.previous`.
class RunDirectory {
 public:
  /// @throw diagnostics::Failure(bad_usage) naming --out
  explicit RunDirectory(std::filesystem::path path);
  RunDirectory(const RunDirectory&) = delete;
  RunDirectory& operator=(const RunDirectory&) = delete;
  ~RunDirectory();

  /// Whether something of this run was recorded when last looked.
  [[nodiscard]] bool begun() const { return begun_; }
  /// Looks, and removes what was set aside, but for the log, once something is. Cheap, for a loop.
  void look();

  [[nodiscard]] std::filesystem::path operator/(const std::string& file) const {
    return path_ / file;
  }
  /// Where a process leaves its counters, until they are in the summary.
  [[nodiscard]] std::filesystem::path statistics_path(loop::Role role) const;
  /// The counters of the processes that wrote them; removes their files.
  [[nodiscard]] std::vector<node::Statistics> take_statistics() const;
  /// Those of our files that exist, for people.
  [[nodiscard]] std::vector<std::filesystem::path> files() const;

 private:
  [[noreturn]] void refuse(const std::string& why) const;
  [[nodiscard]] std::filesystem::path aside(const std::string& file) const;
  void restore();

  std::filesystem::path path_;
  process::FileDescriptor lock_;
  bool begun_ = false;
};

/// How a run ended.
struct RunEnd {
  diagnostics::ExitCode code = diagnostics::ExitCode::done;
  report::RunFacts facts;                      ///< of the log only once it is read back
  std::vector<node::Statistics> statistics;    ///< of the processes that left theirs
  std::vector<std::string> consequences = {};  ///< of the fault, lines to be said after it
};

/// What is known of the run before it begins.
report::RunFacts planned_facts(const PlannedRun& run);

/// Tells of the runs one after another what has become of them, and of several at the end in one
/// table; their JSON is one object, by robot.
class Conclusions {
 public:
  /// Reads the log back, tells the first cause and what came of it, writes summary, figure and
  /// report, and for people the closing table. Of a run that has not begun there are neither files
  /// nor table.
  void add(const PlannedRun& run, RunDirectory& out, RunEnd end);
  /// The exit code of the first that did not end well.
  [[nodiscard]] diagnostics::ExitCode finish() const;

 private:
  bool braces_ = false;
  std::string rows_;
  int count_ = 0;
  diagnostics::ExitCode code_ = diagnostics::ExitCode::done;
};

}  // namespace tachless::launch

#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "controller/registry.h"
#include "experiment/scenario.h"
#include "launch/placement.h"
#include "launch/supervise.h"
#include "loop/messages.h"
#include "node/options.h"
#include "node/statistics.h"

/// What `tachless run` starts and where it writes, worked out and checked before anything is
/// started. Starts no process.
namespace tachless::launch {

/// Of one robot's run.
struct RunOptions {
  std::filesystem::path scenario;
  std::string robot;          ///< its name where the command line has several; empty: it has one
  std::filesystem::path out;  ///< empty: out/<the scenario's name>; of several: out
  std::int64_t run_id = 0;    ///< 0: the time
  std::vector<std::string> overrides;
  std::string mode;
  std::string duration_s;
  std::string lcm_url = node::default_lcm_url;
  std::string key_file;
  std::string placement = "auto";  ///< see choose_placement
  std::string law_program;  ///< shell command of the program with the law; empty: none of its own
  std::string measurement;  ///< that `law_program` is fed with, where the scenario does not say
  std::string restart;      ///< the process to start again when a signal kills it; empty: none
  bool isolate = false;
  bool in_process = false;   ///< without a bus; lockstep only
  bool any_verdict = false;  ///< a limit cycle, divergence or saturation is no failure
  bool cross_check = false;  ///< compare Simbody's mechanics with the library's own first
  bool force = false;        ///< run a loop that is unstable when linearised
  bool quiet = false;
  bool verbose = false;
  bool json = false;
  bool visualize = false;

  [[nodiscard]] std::vector<std::string> all_overrides() const;
  /// With the law that it runs under: the scenario's, or that of `law_program`.
  [[nodiscard]] controller::MakeLaw make_law() const;
  /// `line`, after "<robot>: " where there are several.
  [[nodiscard]] std::string named(std::string_view line) const;
  /// Where the results go.
  [[nodiscard]] std::filesystem::path directory(const experiment::Scenario& checked) const;
};

/// The measurement of the law in whose place `options.law_program` comes; empty where the
/// scenario's law is external already, or stays.
/// @throw diagnostics::Failure(bad_usage)
std::string measurement_wanted(const RunOptions& options);

/// Whether the four programs of each of `runs` can open what they need.
/// @throw diagnostics::Failure(bad_usage) naming the limit
void require_open_files(std::size_t runs);

/// Whether robots of these two runs use no channel in common.
/// @throw diagnostics::Failure(bad_usage) naming both files, the robots' names and the channel
void require_own_channels(const experiment::Scenario& one, const experiment::Scenario& other);

/// The scenario of a run. What a process would refuse later is refused here.
/// @throw diagnostics::Failure(bad_usage)
experiment::Scenario checked_scenario(const RunOptions& options);

/// Moves this process into a private network where that is wanted, or needed because the host has
/// no usable multicast. Returns whether it did.
/// @throw diagnostics::Failure(bad_usage)
bool prepare_network(const RunOptions& options);

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

/// Path of `program` beside this one, and the arguments that say which experiment on which bus.
std::vector<std::string> command_of(const std::string& program, const RunOptions& options);

/// The four processes, in the order in which they are started.
std::vector<Process> run_processes(const RunOptions& options, const Placement& placement,
                                   const RunDirectory& out);

}  // namespace tachless::launch

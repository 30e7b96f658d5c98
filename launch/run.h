#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "controller/registry.h"
#include "diagnostics/failure.h"
#include "experiment/scenario.h"
#include "launch/progress.h"
#include "node/options.h"

/// `tachless run`, from its options to the exit code: what it runs, worked out and checked before
/// anything is started (run_plan.cpp), and carried out in four processes each (run_on_bus.cpp) or
/// in this one (run.cpp). Declares no option (verb/run.cpp).
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

/// A line that is said of a run before it starts.
struct Remark {
  bool warns = false;
  std::string line;
};

/// What one robot's run is about.
struct PlannedRun {
  RunOptions options;
  experiment::Scenario scenario;
  std::vector<Remark> remarks = {};

  /// On stderr; with --quiet the warnings alone.
  void say_remarks() const;
  /// That of a run which has not begun.
  [[nodiscard]] Progress progress() const;
};

/// The runs of `scenarios`. What a process would refuse later is refused here: a scenario, limits
/// of the machine, channels that two robots would share, an unstable loop without --force, with
/// --cross-check mechanics that differ. The remarks are whether the linearised loop is stable,
/// where the plant has its friction from, what the URDF has that is not as it should be, and what
/// the reference asks in vain of drives and joints.
/// @param options as of `run`
/// @throw diagnostics::Failure(bad_usage), or (check_said_no) of the cross-check
std::vector<PlannedRun> plan_runs(RunOptions options,
                                  const std::vector<std::filesystem::path>& scenarios);

/// Moves this process into a private network where that is wanted, or needed because the host has
/// no usable multicast. Returns whether it did.
/// @throw diagnostics::Failure(bad_usage)
bool prepare_network(const RunOptions& options);

/// Carries out `runs` at once, each in four processes on the bus, to its conclusion.
/// @return and @throw as `run`
diagnostics::ExitCode run_on_bus(const std::vector<PlannedRun>& runs);

/// Runs one scenario or several at once to their end, each in four processes of its own on one bus
/// or, one after another, in this one, where a run writes the log that four processes write, to the
/// last bit; shows how far they are, and writes log, summary, figure and report of each. When one
/// fails, the others are interrupted, or not begun.
/// @param options of all of them; without scenario and robot  @param scenarios at least one
/// @return the exit code (see supervise.h) of the first that did not end well, by itself before
/// because of another
/// @throw diagnostics::Failure for what is refused before anything is started
diagnostics::ExitCode run(const RunOptions& options,
                          const std::vector<std::filesystem::path>& scenarios);

}  // namespace tachless::launch

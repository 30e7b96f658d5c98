#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "base/failure.h"
#include "base/file_descriptor.h"
#include "certify/prediction.h"
#include "cli/progress.h"
#include "controller/registry.h"
#include "messages/messages.h"
#include "report/summary.h"
#include "report/visuals.h"
#include "scenario/scenario.h"
#include "session/options.h"
#include "session/statistics.h"

/// `tachless run`, from its options to the exit code: what it runs, worked out and checked before
/// anything is started (run_plan.cpp), carried out in four processes each (run_on_bus.cpp) or in
/// this one (run.cpp), and what it leaves behind: its directory, and from its log summary, figure
/// and report (run_results.cpp). Declares no option (verb/run.cpp).
namespace tachless::cli {

/// Of one robot's run.
struct RunOptions {
  std::filesystem::path scenario;
  std::string robot;          ///< its name where the command line has several; empty: it has one
  std::filesystem::path out;  ///< empty: out/NAME/DATE-TIME; of several robots a folder for each
  std::int64_t run_id = 0;    ///< 0: the time
  std::vector<std::string> overrides;
  std::string mode;
  std::string duration_s;
  std::string lcm_url = session::default_lcm_url;
  std::string key_file;
  std::string placement = "auto";  ///< see choose_placement
  std::string law_program;    ///< shell command of the program with the law; empty: none of its own
  std::string plant_program;  ///< shell command of the plant, a driver's; empty: the emulator
  std::string measurement;    ///< that `law_program` is fed with, where the scenario does not say
  bool isolate = false;
  bool in_process = false;   ///< without a bus; lockstep only
  bool any_outcome = false;  ///< no verdict is a failure
  bool force = false;        ///< run a loop that is unstable when linearised
  bool overwrite = false;    ///< replace the results of an earlier run in `out`
  bool quiet = false;
  bool verbose = false;
  bool json = false;
  bool watch = false;    ///< show it in a browser while it goes on
  bool dry_run = false;  ///< `plant_program` sends nothing to its robot
  bool ramp = false;     ///< first bring the robot of `plant_program` to where the scenario begins

  [[nodiscard]] std::vector<std::string> all_overrides() const;
  /// `line`, after "<robot>: " where there are several.
  [[nodiscard]] std::string named(std::string_view line) const;
};

/// The measurement of the law in whose place `options.law_program` comes; empty where the
/// scenario's law is external already, or stays. @throw base::Failure(bad_usage)
std::string measurement_wanted(const RunOptions& options);

/// The law that a scenario is run under: its own, or that of `law_program` if there is one.
controller::MakeLaw make_law(const std::string& law_program);

/// What the law of `law_program` answers, for the analysis of the sampled loop: it is started here,
/// ends with the last copy, and what its law calls itself becomes `scenario.controller.announced`.
/// Empty when there is no such program. @throw base::Failure as controller::LawProgram
linear::LawAnswers law_answers(scenario::Scenario& scenario, const std::string& law_program);

/// A line printed before the run starts.
struct Remark {
  bool warns = false;
  std::string line;
};

/// What one robot's run is about.
struct PlannedRun {
  RunOptions options;
  scenario::Scenario scenario;
  std::vector<Remark> remarks = {};
  certify::Prediction predicted = {};

  /// Of the robot, from the scenario's URDF file; none, after a warning, where it cannot be read.
  [[nodiscard]] report::Visuals visuals() const;
  /// On stderr; with --quiet the warnings alone.
  void print_remarks() const;
  /// That of a run which has not begun.
  [[nodiscard]] Progress progress() const;
};

/// The runs of `scenarios`. What a process would refuse later is refused here: a scenario, limits
/// of the machine, channels that two robots would share, an unstable loop without --force. The
/// remarks are whether the linearised loop is stable, where the plant has its friction from, what
/// the URDF has that is not as it should be, and what of the reference is beyond drives and
/// joints.
/// @param options as of `run`
/// @throw base::Failure(bad_usage)
std::vector<PlannedRun> plan_runs(RunOptions options,
                                  const std::vector<std::filesystem::path>& scenarios);

/// In the order in which their processes are started.
inline constexpr std::array roles = {messages::Role::logger, messages::Role::controller,
                                     messages::Role::reference, messages::Role::plant};

/// The directory of a run's results, locked against a second run until destruction: --out, or
/// out/NAME/DATE-TIME with the link out/NAME/latest once the run has begun. That of a run that does
/// not begin is removed, or left with the results of the earlier run that it would have replaced.
class RunDirectory {
 public:
  /// @throw base::Failure(bad_usage) naming the directory: it cannot be used, or, without
  /// --overwrite, holds results
  explicit RunDirectory(const PlannedRun& run);
  RunDirectory(const RunDirectory&) = delete;
  RunDirectory& operator=(const RunDirectory&) = delete;
  ~RunDirectory();

  /// Whether something of this run was recorded when last looked.
  [[nodiscard]] bool begun() const { return begun_; }
  /// Looks; once something is, sets the link and removes an earlier run's results. Cheap.
  bool look();

  [[nodiscard]] std::filesystem::path operator/(const std::string& file) const {
    return path_ / file;
  }
  /// Where a process leaves its counters, until they are in the summary.
  [[nodiscard]] std::filesystem::path statistics_path(messages::Role role) const;
  /// The counters of the processes that wrote them; removes their files.
  [[nodiscard]] std::vector<session::Statistics> take_statistics() const;
  /// Those of our files that exist, for people.
  [[nodiscard]] std::vector<std::filesystem::path> files() const;

 private:
  [[noreturn]] void refuse(const std::string& why,
                           const std::string& remedy = "choose another directory") const;
  void make(const std::filesystem::path& directory);
  void make_by_time();
  void clear(bool overwrite);
  void put_back() const;

  std::filesystem::path path_;
  std::filesystem::path runs_;  ///< out/NAME; empty: --out was given
  base::FileDescriptor lock_;
  bool begun_ = false;
};

/// How a run ended.
struct RunEnd {
  base::ExitCode code = base::ExitCode::done;
  report::RunFacts facts;                       ///< of the run and the log by `Conclusions`
  std::vector<session::Statistics> statistics;  ///< of the processes that left theirs
  std::vector<std::string> consequences = {};   ///< of the fault: lines printed after it
};

/// Reports the results of the runs one after another, and of several at the end in one
/// table; their JSON is one object, by robot.
class Conclusions {
 public:
  /// Reads the log back, prints the first cause and its consequences, writes summary, figure and
  /// report, and for people the closing table. Of a run that has not begun there are neither files
  /// nor table.
  void add(const PlannedRun& run, RunDirectory& out, RunEnd end);
  /// The exit code of the first that did not end well.
  [[nodiscard]] base::ExitCode finish() const;

 private:
  bool braces_ = false;
  std::vector<std::vector<std::string>> rows_;  ///< of the table of several robots
  int count_ = 0;
  base::ExitCode code_ = base::ExitCode::done;
};

/// Moves this process into a private network where that is wanted, or needed because the host has
/// no usable multicast. Returns whether it did.
/// @throw base::Failure(bad_usage)
bool prepare_network(const RunOptions& options);

/// Brings the robot of the run's driver from where it stands to where the scenario begins, by a run
/// of the scenario's law along a slow motion, with its own log: at most a tenth of each joint's
/// limits of speed, and of torque beyond what holds it.
/// @return of the run that ended badly, or done; @throw base::Failure(check_said_no) when
/// the robot is outside of its range or has not arrived, otherwise as `run`
base::ExitCode ramp(const RunOptions& options, const PlannedRun& run);

/// Carries out `runs` at once, each in four processes on the bus, to its conclusion.
/// @return and @throw as `run`
base::ExitCode run_on_bus(const std::vector<PlannedRun>& runs);

/// Runs one scenario or several at once to their end, each in four processes of its own on one bus
/// or, one after another, in this one, where a run writes the log that four processes write, to the
/// last bit; shows how far they are, and writes log, summary, figure and report of each. When one
/// fails, the others are interrupted, or not begun.
/// @param options of all of them; without scenario and robot  @param scenarios at least one
/// @return the exit code (see supervise.h) of the first that did not end well, by itself before
/// because of another
/// @throw base::Failure for what is refused before anything is started
base::ExitCode run(const RunOptions& options, const std::vector<std::filesystem::path>& scenarios);

}  // namespace tachless::cli

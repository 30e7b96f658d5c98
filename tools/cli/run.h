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

/// `tachless run`, from its options to the exit code. run_plan.cpp plans and checks the runs before
/// anything is started. run_on_bus.cpp carries out each run in four processes, and run.cpp in this
/// process. run_results.cpp keeps the directory, and makes summary, figure and report from the log.
/// verb/run.cpp declares the options.
namespace tachless::cli {

/// Options of one robot's run.
struct RunOptions {
  std::filesystem::path scenario;
  std::string robot;  ///< name, if the command line has several robots; else empty
  /// Folder of the results; empty: out/NAME/DATE-TIME. With several robots each has a folder of its
  /// own in it.
  std::filesystem::path out;
  std::int64_t run_id = 0;  ///< id of the run; 0: the present time [us]
  std::vector<std::string> overrides;
  std::string mode;
  std::string duration_s;
  std::string lcm_url = session::default_lcm_url;
  std::string key_file;
  std::string placement = "auto";  ///< placement on CPUs; see `choose_placement`
  std::string law_program;         ///< shell command of the program with the law; empty: none
  std::string plant_program;       ///< shell command of the plant, a driver's; empty: the emulator
  std::string measurement;         ///< measurement for `law_program` if the scenario gives none
  bool isolate = false;
  bool in_process = false;   ///< without a bus; lockstep only
  bool any_outcome = false;  ///< no verdict is a failure
  bool force = false;        ///< run a loop that is unstable when linearised
  bool overwrite = false;    ///< replace the results of an earlier run in `out`
  bool quiet = false;
  bool verbose = false;
  /// One of another verb's trials: unless `verbose`, no line of logger, controller and reference is
  /// shown, no stop by the plant's guards and no late tick.
  bool trial = false;
  bool json = false;
  bool watch = false;    ///< show the run in a browser while it lasts
  bool dry_run = false;  ///< `plant_program` sends nothing to its robot
  bool ramp = false;     ///< first bring the robot of `plant_program` to the scenario's start

  [[nodiscard]] std::vector<std::string> all_overrides() const;
  /// Returns `line`, after "<robot>: " if there are several robots.
  [[nodiscard]] std::string named(std::string_view line) const;
  /// Returns whether a trial's end with this code is left to the verb.
  [[nodiscard]] bool leaves_to_verb(base::ExitCode code) const {
    return trial && !verbose &&
           (code == base::ExitCode::protective_stop || code == base::ExitCode::check_said_no);
  }
};

/// Returns the measurement of the law that `options.law_program` replaces. The result is empty if
/// the scenario's law is external already, or is not replaced.
/// @throw base::Failure(bad_usage) if the scenario is refused
std::string measurement_wanted(const RunOptions& options);

/// Returns the maker of a run's law: the law of `law_program` if there is one, else the scenario's.
controller::MakeLaw make_law(const std::string& law_program);

/// Starts `law_program` and returns its law's answers, for the analysis of the sampled loop. The
/// program ends with the last copy of the result. `scenario.controller.announced` becomes the name
/// that the law announces. The result is empty if there is no such program.
/// @throw base::Failure as controller::LawProgram
linear::LawAnswers law_answers(scenario::Scenario& scenario, const std::string& law_program);

/// A line printed before the run starts.
struct Remark {
  bool warns = false;
  std::string line;
};

/// Run of one robot, planned and checked.
struct PlannedRun {
  RunOptions options;
  scenario::Scenario scenario;
  std::vector<Remark> remarks = {};
  certify::Prediction predicted = {};

  /// Returns the robot's visuals from the scenario's URDF file. If the file cannot be read, it
  /// warns and returns none.
  [[nodiscard]] report::Visuals visuals() const;
  /// Prints the remarks on stderr; with --quiet, only the warnings.
  void print_remarks() const;
  /// Returns the progress of a run that has not begun.
  [[nodiscard]] Progress progress() const;
};

/// Returns the runs of `scenarios`. The function refuses everything that a process would refuse
/// later: a scenario, limits of the machine, channels that two robots would share. It also refuses
/// an unstable loop, unless --force is given. The remarks name the stability of the linearised
/// loop, and the source of the plant's friction. They also name faults of the URDF, and references
/// beyond the limits of drives and joints.
/// @param options as for `run`
/// @throw base::Failure(bad_usage) for the first refusal; names file, key, value and remedy
std::vector<PlannedRun> plan_runs(RunOptions options,
                                  const std::vector<std::filesystem::path>& scenarios);

/// The roles, in the order in which their processes are started.
inline constexpr std::array roles = {messages::Role::logger, messages::Role::controller,
                                     messages::Role::reference, messages::Role::plant};

/// The directory of a run's results, locked against a second run until destruction. It is --out, or
/// out/NAME/DATE-TIME, to which out/NAME/latest links once the run has begun. If the run does not
/// begin, the directory is removed, or keeps the results of an earlier run.
class RunDirectory {
 public:
  /// @throw base::Failure(bad_usage) naming the directory, if it cannot be used, or holds results
  /// and --overwrite is not given
  explicit RunDirectory(const PlannedRun& run);
  RunDirectory(const RunDirectory&) = delete;
  RunDirectory& operator=(const RunDirectory&) = delete;
  ~RunDirectory();

  /// Returns whether the last `look` found a record of this run.
  [[nodiscard]] bool begun() const { return begun_; }
  /// Looks for a record of this run. If there is one, sets the link and removes an earlier run's
  /// results. The call is cheap.
  bool look();

  [[nodiscard]] std::filesystem::path operator/(const std::string& file) const {
    return path_ / file;
  }
  /// Returns the path of the file in which a process leaves its counters for the summary.
  [[nodiscard]] std::filesystem::path statistics_path(messages::Role role) const;
  /// Returns the counters of the processes that wrote them, and removes their files.
  [[nodiscard]] std::vector<session::Statistics> take_statistics() const;
  /// Returns the paths of the result files that exist, for people.
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

/// The end of a run.
struct RunEnd {
  base::ExitCode code = base::ExitCode::done;
  report::RunFacts facts;                       ///< `Conclusions` adds the facts of run and log
  std::vector<session::Statistics> statistics;  ///< statistics of the processes that wrote them
  /// Consequences of the fault: lines printed after the fault.
  std::vector<std::string> consequences = {};
};

/// Reports of the runs' results, one after another. Several runs also get one table at the end.
/// Their JSON is one object, with a key for each robot.
class Conclusions {
 public:
  /// Reads the log back, and prints the first cause and its consequences. It writes summary, figure
  /// and report, and for people the closing table. A run that has not begun has neither files nor
  /// table.
  void add(const PlannedRun& run, RunDirectory& out, RunEnd end);
  /// Returns the exit code of the first run that did not end well.
  [[nodiscard]] base::ExitCode finish() const;

 private:
  bool braces_ = false;
  std::vector<std::vector<std::string>> rows_;  ///< rows of the table of several robots
  int count_ = 0;
  base::ExitCode code_ = base::ExitCode::done;
};

/// Moves this process into a private network if the options ask for it, or if the host has no
/// usable multicast. @return whether it moved
/// @throw base::Failure(bad_usage) if the system refuses a network namespace
bool prepare_network(const RunOptions& options);

/// Brings the driver's robot from its present position to the scenario's start. The scenario's law
/// does this in a run along a slow motion, with its own log. The motion uses at most a tenth of
/// each joint's speed limit. Beyond the holding torque it uses at most a tenth of the torque limit.
/// @return the code of the run that ended badly, or done
/// @throw base::Failure(check_said_no) if the robot is outside its range or has not arrived;
/// otherwise as `run`
base::ExitCode ramp(const RunOptions& options, const PlannedRun& run);

/// Carries out `runs` at once, each in four processes on the bus, to its conclusion.
/// @return and @throw as `run`
base::ExitCode run_on_bus(const std::vector<PlannedRun>& runs);

/// Runs one scenario or several to their end, and shows their progress. On one bus all run at once,
/// each in four processes of its own. In this process they run one after another, and write the
/// same logs to the last bit. Each run gets log, summary, figure and report. If one fails, the
/// others are interrupted, or not begun.
/// @param options options of all runs, without scenario and robot
/// @param scenarios at least one
/// @return the exit code (see supervise.h) of the first run that did not end well. A run that
/// failed by itself takes precedence over a run that ended because of another run
/// @throw base::Failure if a run is refused before anything is started
base::ExitCode run(const RunOptions& options, const std::vector<std::filesystem::path>& scenarios);

}  // namespace tachless::cli

#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/child.h"
#include "base/failure.h"
#include "messages/messages.h"
#include "scenario/scenario.h"

namespace tachless::cli {

/// A process to start. Its stdout and stderr come line by line to `SuperviseOptions::on_line`. A
/// line that is marked as an error (base::error_mark) becomes `ProcessEnd::cause` instead.
struct Process {
  std::string name;                  ///< for people: "controller"
  std::vector<std::string> command;  ///< program (a path) and arguments
  /// CPUs on which the process may execute; empty: those of this process.
  std::vector<int> cpus = {};
  bool relayed = false;       ///< the output of the process never waits for this process
  bool drives_robot = false;  ///< the process may hold a robot's torque (base::give_notice)
};

/// CPUs on which the four processes of a run execute.
struct Placement {
  std::string words = "spread over CPUs";  ///< for people: "together on CPU 1"
  /// CPUs by role; empty: all allowed CPUs.
  std::array<std::vector<int>, messages::num_roles> cpus;

  [[nodiscard]] const std::vector<int>& cpus_of(messages::Role role) const {
    return cpus[static_cast<std::size_t>(role)];
  }
};

/// Returns the CPUs of a run's processes. `auto` in lockstep: plant, controller and reference on
/// one CPU, the logger on the others. `auto` in realtime, or with one CPU: as `none`. `none`: the
/// kernel places them.
/// @param index number of the robot in the run; each robot gets another CPU if there are enough
/// CPUs
/// @throw base::Failure(bad_usage) naming --placement and what is allowed
Placement choose_placement(const std::string& wanted, scenario::Mode mode, std::size_t index);

/// End of a process.
struct ProcessEnd : base::End {
  std::string name;
  bool on_order = false;  ///< the process ended after a signal of this process
  bool overdue = false;   ///< the process still ran long after another one had ended well
  /// Last line that may give the reason for the end, without the program's name.
  std::string last_line;
  std::string cause;  ///< reason for the end, from the error line, without mark and program's name
  /// Bytes of output that were dropped, because this process read too slowly.
  std::int64_t dropped_bytes = 0;
  std::int64_t hidden_lines = 0;  ///< lines of its output beyond `most_lines_per_s`
  bool robot_started = false;     ///< the process has begun to start its robot
  bool robot_stopped = false;     ///< the `stop` of its robot has returned
};

/// Options of supervision: callbacks, and waiting times before processes are ended.
struct SuperviseOptions {
  std::function<void(std::string_view name, std::string_view line)> on_line;
  std::function<void()> on_wake;             ///< called at least every 50 ms
  std::function<bool()> begun;               ///< whether tick 0 was reached; empty: yes
  std::chrono::milliseconds grace{300};      ///< from the first failure to SIGTERM for the others
  std::chrono::milliseconds patience{1000};  ///< from SIGTERM to SIGKILL
  std::chrono::milliseconds interrupt_grace{3000};  ///< from the forwarded SIGINT to SIGTERM
  std::chrono::milliseconds end_together{10000};    ///< from the first clean end to the last
  int most_lines_per_s = 200;                       ///< most lines of a process passed to `on_line`
};

struct Supervision {
  std::vector<ProcessEnd> ends;        ///< ends of the processes, in the order given
  std::optional<std::size_t> culprit;  ///< index of the process that ended the run
  bool begun = true;                   ///< tick 0 was reached when the first process ended
  /// A signal to this process, or another run's failure, interrupted the run.
  bool interrupted = false;
  std::optional<std::size_t> because_of;  ///< index of the run whose failure interrupted this one

  /// Returns true if one of its processes ended the run.
  [[nodiscard]] bool failed() const { return culprit.has_value() && !interrupted; }
};

/// The processes of one run.
struct Supervised {
  std::vector<Process> processes;
  SuperviseOptions options;
};

/// Starts the processes of all runs, and returns when all have ended. Each process has a process
/// group of its own, so Ctrl-C reaches this process alone. SIGINT, SIGTERM, SIGHUP, SIGQUIT and
/// SIGPIPE are passed on once, as SIGINT, also to processes already sent SIGTERM. A second signal
/// kills the processes. If this process ends, its children get SIGTERM.
///
/// When one process fails, the others of its run get the time `grace` to end by themselves, then
/// SIGTERM, then SIGKILL. The other runs are interrupted at once. A process whose robot is started
/// and not stopped gets SIGKILL only after a third signal of the user. Until then a line in each
/// second names the emergency stop.
/// @return in the order of the runs
/// @throw base::Failure(bad_usage) naming the program that cannot be started; programs started
/// before it have then been killed.
std::vector<Supervision> supervise(const std::vector<Supervised>& runs);

/// Returns one line: "controller was killed by signal 9 (Killed): …", "plant: protective stop at
/// tick …".
std::string describe(const ProcessEnd& end);

/// Returns the other processes that failed: "plant (exit code 3), logger (exit code 3)"; empty:
/// none.
std::string others_that_failed(const Supervision& supervision);

/// Returns the run's exit code: 130 when interrupted, else the culprit's own. A lost culprit gives
/// 5 if another process brought the robot to a protective stop, else 3. A culprit is lost if a
/// signal killed it, or if it ended with 1 before the run.
base::ExitCode exit_code(const Supervision& supervision);

}  // namespace tachless::cli

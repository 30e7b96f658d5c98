// `stop` of the robot is called whatever hangs: the real programs with faulty drivers and laws
// (fault.h), an output that nobody reads, and a launcher that is stopped.

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <cstdlib>
#include <deque>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "base/child.h"
#include "base/json_text.h"
#include "tests/support/program.h"
#include "tests/support/temporary_directory.h"

namespace tachless::system_test::stopping_test {
namespace {

using namespace std::chrono_literals;
using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;
using Words = std::vector<std::string>;

constexpr int peer_lost = 3, protective_stop = 5, interrupted = 130;
const std::string programs = TACHLESS_BINARY_DIR "/bin/";
const std::string rig = TACHLESS_SOURCE_DIR "/examples/own_driver/rig.yaml";

/// One start: a verb, its options, and the fault.
struct Case {
  std::string fault;      ///< as in FAULT
  bool is_clock = false;  ///< the driver is
  bool emulated = false;  ///< no driver; the fault is the law's
  Words options = {};     ///< of `tachless run`
  std::string verb = "run";
  bool output_is_read = true;
  int at = 100;  ///< the call that fails
};

/// One start of the launcher in a network of its own.
class Launched {
 public:
  explicit Launched(const Case& what) : case_(what) {
    static int count = 0;
    mark_ = "STOPPING_TEST=" + std::to_string(getpid()) + "." + std::to_string(count++);
    setenv("STOPPING_TEST", mark_.substr(mark_.find('=') + 1).c_str(), 1);
    setenv("FAULT", what.fault.c_str(), 1);
    setenv("FAULT_AT", std::to_string(what.at).c_str(), 1);
    setenv("NOTES", notes_path().c_str(), 1);
    what.is_clock ? setenv("CLOCK", "1", 1) : unsetenv("CLOCK");
    child_ = base::start(command());
    // A full pipe stands for a pager, a stopped terminal, and a connection that hangs.
    if (!what.output_is_read) fcntl(child_.output.get(), F_SETPIPE_SZ, 4096);
  }

  void signal(int number) const { kill(child_.pid, number); }

  /// Waits for the launcher's end, and for that of all it has started.
  /// @return its exit code
  int wait() {
    wait_until(name() + " ends", [this] {
      if (case_.output_is_read) {
        base::read_lines(child_, [this](const std::string& line) { output_ += line + "\n"; });
      }
      if (!end_) end_ = base::take_end(child_);
      return end_.has_value();
    });
    wait_until(
        name() + " leaves no process", [this] { return processes() == 0; }, 20s);
    if (case_.output_is_read) {
      base::read_rest(child_, 0ms, [this](const std::string& line) { output_ += line + "\n"; });
    }
    // No robot is started between two trials of a commissioning; a signal then ends the launcher
    // itself.
    if (case_.verb == "commission" && end_->signal == SIGINT) return interrupted;
    EXPECT_EQ(end_->signal, 0) << name();
    return end_->exit_code;
  }

  /// Events that its driver, or law, has written down.
  [[nodiscard]] Words notes() const {
    std::istringstream text(std::filesystem::exists(notes_path()) ? contents(notes_path()) : "");
    return {std::istream_iterator<std::string>(text), {}};
  }
  [[nodiscard]] bool has_noted(const std::string& event) const {
    return std::ranges::count(notes(), event) > 0;
  }
  [[nodiscard]] const std::string& output() const { return output_; }
  [[nodiscard]] std::string name() const {
    return case_.verb + " " + (case_.options.empty() ? "" : case_.options.front() + " ") +
           (case_.is_clock ? "clock " : "") + case_.fault;
  }
  [[nodiscard]] bool has_begun() const { return !case_.fault.starts_with("start "); }
  /// Returns true if a summary is in the folder --out: a ramp has folders of its own before it.
  [[nodiscard]] bool has_summary() const {
    const bool ramps = !case_.options.empty() && case_.options.front() == "--ramp";
    return has_begun() && case_.verb == "run" && !ramps;
  }
  /// "robot_stopped" of summary.json.
  [[nodiscard]] nlohmann::json robot_stopped() const {
    return base::parse_json(contents(directory_ / "out/summary.json"))["robot_stopped"];
  }

 private:
  [[nodiscard]] std::string notes_path() const { return (directory_ / "notes").string(); }

  [[nodiscard]] Words command() const {
    Words words = {programs + "tachless", case_.verb, rig};
    if (case_.emulated) {
      words.insert(words.end(), {"--controller", programs + "tachless-faulty-law"});
      for (const char* each : {"controller.law=external", "controller.measurement=POSITION"}) {
        words.insert(words.end(), {"--set", each});
      }
    } else {
      words.insert(words.end(), {"--plant", programs + "tachless-faulty-driver"});
    }
    // The arm hangs still. Any number of deadlines may be missed, so that no busy machine ends it.
    for (const char* each :
         {"loop.period_s=0.002", "loop.max_missed=400", "loop.max_missed_share=1",
          "loop.give_up_s=0.5", "plant.following_error_rad=100",
          "reference={hold: {position_rad: [0, 0]}}"}) {
      words.insert(words.end(), {"--set", each});
    }
    setenv("TACHLESS_ISOLATE", "1", 1);
    words.insert(words.end(), {"--out", (directory_ / "out").string()});
    if (case_.verb == "run") words.insert(words.end(), {"--any-outcome", "--force"});
    words.insert(words.end(), case_.options.begin(), case_.options.end());
    return words;
  }

  /// How many processes have this start's mark in their environment.
  [[nodiscard]] int processes() const {
    int count = 0;
    for (const auto& entry : std::filesystem::directory_iterator("/proc")) {
      std::ifstream file(entry.path() / "environ");
      const std::string all((std::istreambuf_iterator<char>(file)), {});
      count += ("\0" + all).find(mark_ + '\0') != std::string::npos ? 1 : 0;
    }
    return count;
  }

  Case case_;
  TemporaryDirectory directory_;
  std::string mark_, output_;
  base::Child child_;
  std::optional<base::End> end_;
};

/// The started robot was stopped, and the launcher says so. A run that has not begun leaves no
/// summary.
void expect_stopped(const Launched& run) {
  EXPECT_THAT(run.notes(), AllOf(Contains("start"), Contains("stop"))) << run.output();
  if (run.has_summary()) {
    EXPECT_EQ(run.robot_stopped(), true) << run.name();
  } else {
    EXPECT_THAT(run.output(), Not(HasSubstr("NOT stopped")));
  }
}

const Words endless = {"--duration", "600"};
const Words ramp = {"--ramp", "--set", "plant.initial.position_rad=[0.1, 0]"};

/// A commissioning whose driver fails. A trial in which a tick is late ends the commissioning with
/// another message, so the driver fails within the first trial.
Case commissioned(const std::string& fault) {
  return {.fault = fault, .verb = "commission", .at = 5};
}

/// Runs side by side.
std::deque<Launched> start(const std::vector<Case>& cases) {
  std::deque<Launched> runs;
  for (const Case& each : cases) runs.emplace_back(each);
  return runs;
}

TEST(Stopping, IsCalledOnceADriverThatBlocksReturns) {
  for (Launched& run : start({{.fault = "start block", .options = endless},
                              {.fault = "read block", .options = endless},
                              {.fault = "hold block", .options = endless},
                              {.fault = "start block", .is_clock = true, .options = endless},
                              {.fault = "exchange block", .is_clock = true, .options = endless}})) {
    EXPECT_THAT(run.wait(), AnyOf(peer_lost, protective_stop)) << run.name() << run.output();
    expect_stopped(run);
    EXPECT_THAT(run.output(), HasSubstr("use the emergency stop"));
  }
}

TEST(Stopping, IsWaitedForWhenItBlocksItself) {
  for (Launched& run :
       start({{.fault = "stop block", .options = {"--duration", "2"}},
              {.fault = "stop block", .is_clock = true, .options = {"--duration", "2"}}})) {
    EXPECT_EQ(run.wait(), peer_lost) << run.name() << run.output();
    expect_stopped(run);
  }
}

TEST(Stopping, IsCalledWhenADriverOrALawThrows) {
  for (Launched& run : start({{.fault = "start throw", .options = endless},
                              {.fault = "read throw", .options = endless},
                              {.fault = "hold throw", .options = endless},
                              {.fault = "exchange throw", .is_clock = true, .options = endless}})) {
    EXPECT_EQ(run.wait(), protective_stop) << run.name() << run.output();
    expect_stopped(run);
    EXPECT_THAT(run.output(), AllOf(HasSubstr("plant: the driver threw: drive 2 is too hot"),
                                    Not(HasSubstr("internal error"))));
  }
  for (Launched& run : start({{.fault = "step throw", .emulated = true, .options = endless},
                              {.fault = "torques seven", .emulated = true, .options = endless},
                              {.fault = "signals one", .emulated = true, .options = endless}})) {
    EXPECT_EQ(run.wait(), protective_stop) << run.name() << run.output();
    EXPECT_THAT(run.output(), AllOf(HasSubstr("controller: the law "), Not(HasSubstr("internal"))));
  }
}

TEST(Stopping, IsReportedAsNotCalledWhenTheDriverDies) {
  for (Launched& run : start({{.fault = "start exit", .options = endless},
                              {.fault = "read exit", .options = endless},
                              {.fault = "hold kill", .options = endless},
                              {.fault = "exchange kill", .is_clock = true, .options = endless},
                              {.fault = "hold kill", .options = ramp}})) {
    EXPECT_EQ(run.wait(), peer_lost) << run.name() << run.output();
    EXPECT_FALSE(run.has_noted("stop"));
    if (run.has_summary()) {
      EXPECT_EQ(run.robot_stopped(), false);
    }
    EXPECT_THAT(run.output(), HasSubstr("robot NOT stopped")) << run.name();
  }
  Launched commission(commissioned("hold kill"));
  EXPECT_NE(commission.wait(), 0) << commission.output();
  EXPECT_THAT(commission.output(), HasSubstr("NOT stopped"));
}

TEST(Stopping, DoesNotDependOnWhoReadsTheOutput) {
  const Words some = {"--duration", "3"};
  auto runs = start(
      {{.fault = "read chatter", .options = endless, .output_is_read = false},
       {.fault = "read flood", .options = endless, .output_is_read = false},
       {.fault = "exchange flood", .is_clock = true, .options = endless, .output_is_read = false},
       {.fault = "read flood", .options = ramp, .output_is_read = false},
       {.fault = "read flood", .verb = "commission", .output_is_read = false, .at = 5},
       {.fault = "step flood", .emulated = true, .options = endless, .output_is_read = false},
       {.fault = "step flood",
        .emulated = true,
        .options = {"--duration", "600", "--set", "loop.mode=lockstep"},
        .output_is_read = false}});
  for (Launched& run : runs) {
    wait_until("the fault of " + run.name(), [&] { return run.has_noted("fault"); });
    run.signal(SIGINT);
  }
  for (Launched& run : runs) {
    EXPECT_EQ(run.wait(), interrupted) << run.name();
    if (run.has_noted("start")) expect_stopped(run);
  }
}

TEST(Stopping, IsCalledWhileTheLauncherIsStopped) {
  for (Launched& run :
       start({{.fault = "read chatter", .options = {"--duration", "3"}},
              {.fault = "exchange chatter", .is_clock = true, .options = {"--duration", "3"}}})) {
    wait_until("the driver prints", [&] { return run.has_noted("fault"); });
    run.signal(SIGSTOP);
    wait_until("the robot is stopped", [&] { return run.has_noted("stop"); });
    run.signal(SIGCONT);
    EXPECT_EQ(run.wait(), 0) << run.output();
    expect_stopped(run);
  }
}

TEST(Stopping, IsCalledInARampAndNotInADryRun) {
  auto runs = start({{.fault = "hold throw", .options = ramp},
                     {.fault = "hold block", .options = ramp},
                     {.fault = "read throw", .options = {"--dry-run", "--duration", "600"}},
                     {.fault = "read block", .options = {"--dry-run", "--duration", "600"}}});
  for (std::size_t i = 0; i < runs.size(); ++i) {
    Launched& run = runs[i];
    EXPECT_THAT(run.wait(), AnyOf(peer_lost, protective_stop)) << run.name() << run.output();
    EXPECT_TRUE(run.has_noted("fault")) << run.output();
    EXPECT_EQ(run.has_noted("start"), i < 2) << run.name();
    EXPECT_EQ(run.has_noted("stop"), i < 2) << run.name();
  }
}

TEST(Stopping, IsCalledInACommissioning) {
  for (Launched& run : start({commissioned("hold throw"), commissioned("hold block")})) {
    EXPECT_NE(run.wait(), 0) << run.name() << run.output();
    EXPECT_THAT(run.notes(), AllOf(Contains("start"), Contains("fault"), Contains("stop")))
        << run.output();
    EXPECT_THAT(run.output(), Not(HasSubstr("internal error")));
  }
}

TEST(Stopping, NeverBecomesNecessaryWhereATimeInMillisecondsIsRefused) {
  Launched run({.fault = "time milliseconds", .options = endless});
  EXPECT_EQ(run.wait(), 2) << run.output();
  EXPECT_THAT(run.notes(), ::testing::IsEmpty());
  EXPECT_THAT(run.output(), HasSubstr("give ArmState::time_s in seconds"));
}

}  // namespace
}  // namespace tachless::system_test::stopping_test

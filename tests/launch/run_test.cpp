// `tachless run` as a user runs it: four real processes in a private network.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "logger/run_log.h"
#include "tests/support/temporary_directory.h"

using namespace tachless;

namespace {

namespace fs = std::filesystem;
using std::chrono::seconds;
using ::testing::AllOf;
using ::testing::HasSubstr;
using Clock = std::chrono::steady_clock;

std::string text_of(const fs::path& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

class Run : public ::testing::Test {
 protected:
  void TearDown() override {
    if (launcher_ > 0) {
      kill(launcher_, SIGKILL);
      waitpid(launcher_, nullptr, 0);
    }
  }

  void start(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {"--isolate", "--out", out().string()});
    start_on_this_network(std::move(arguments));
  }

  void start_on_this_network(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {TACHLESS_BINARY_DIR "/bin/tachless", "run",
                                         TACHLESS_SOURCE_DIR "/scenarios/" + scenario_ + ".yaml"});
    std::vector<char*> argv;
    for (std::string& word : arguments) argv.push_back(word.data());
    argv.push_back(nullptr);
    launcher_ = fork();
    ASSERT_GE(launcher_, 0);
    if (launcher_ == 0) {
      [[maybe_unused]] FILE* o = freopen((directory_ / "stdout").c_str(), "w", stdout);
      [[maybe_unused]] FILE* e = freopen((directory_ / "stderr").c_str(), "w", stderr);
      execv(argv[0], argv.data());
      _exit(127);
    }
  }

  int finish() {
    int status = 0;
    waitpid(launcher_, &status, 0);
    launcher_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
  }

  /// The process of that program that the launcher started.
  std::optional<pid_t> child(const std::string& program) const {
    const fs::path children = fs::path("/proc") / std::to_string(launcher_) / "task" /
                              std::to_string(launcher_) / "children";
    std::istringstream pids(text_of(children));
    for (pid_t pid = 0; pids >> pid;) {
      if (text_of(fs::path("/proc") / std::to_string(pid) / "cmdline").find(program) !=
          std::string::npos) {
        return pid;
      }
    }
    return {};
  }

  /// Until the log has grown to some thousand ticks.
  void wait_until_running() const {
    const auto until = Clock::now() + seconds(30);
    std::error_code error;
    while (Clock::now() < until) {
      const auto size = fs::file_size(out() / "lcmlog", error);
      if (!error && size > 500'000) return;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    FAIL() << "the run did not get going: " << standard_error();
  }

  [[nodiscard]] fs::path out() const { return directory_ / "out"; }
  [[nodiscard]] std::string standard_error() const { return text_of(directory_ / "stderr"); }
  [[nodiscard]] std::string standard_output() const { return text_of(directory_ / "stdout"); }
  [[nodiscard]] nlohmann::json summary() const {
    return nlohmann::json::parse(text_of(out() / "summary.json"));
  }

  TemporaryDirectory directory_;
  std::string scenario_ = "paper_rigid";
  pid_t launcher_ = -1;
};

std::map<std::string, std::string> files_in(const fs::path& directory) {
  std::map<std::string, std::string> files;
  for (const auto& entry : fs::directory_iterator(directory)) {
    files[entry.path().filename()] = text_of(entry.path());
  }
  return files;
}

std::int64_t ticks_of(const fs::path& path) {
  logger::RunLog log = logger::RunLog::open(path);
  logger::TickRecord record;
  std::int64_t ticks = 0;
  while (log.next(record)) ++ticks;
  EXPECT_FALSE(log.damage().any());
  return ticks;
}

TEST_F(Run, CompletesWithoutAGapAndLeavesLogSummaryAndFigure) {
  start({"--duration", "0.1", "--run-id", "7"});
  EXPECT_EQ(finish(), 0) << standard_error();
  const nlohmann::json result = summary();
  EXPECT_EQ(result["ticks"], 2000);
  EXPECT_EQ(result["run_id"], 7);
  EXPECT_EQ(result["log"]["gaps"], 0);
  EXPECT_EQ(result["log"]["ticks"], 2000);
  EXPECT_TRUE(result["fault"].is_null());
  EXPECT_EQ(result["position_error_rad"]["peak"].size(), 2U);
  EXPECT_EQ(ticks_of(out() / "lcmlog"), 2000);
  EXPECT_THAT(text_of(out() / "tracking.svg"), HasSubstr("</svg>"));
  const std::string report = text_of(out() / "report.html");
  EXPECT_THAT(report, AllOf(HasSubstr("</html>"), HasSubstr("<figure id=\"round-trip\"")));
  EXPECT_THAT(standard_output(), AllOf(HasSubstr("position error"), HasSubstr("log gaps 0"),
                                       HasSubstr((out() / "tracking.svg").string())));
  std::set<std::string> files;
  for (const auto& entry : fs::directory_iterator(out())) files.insert(entry.path().filename());
  EXPECT_EQ(files,
            (std::set<std::string>{"lcmlog", "report.html", "summary.json", "tracking.svg"}));
}

TEST_F(Run, InOneProcessLeavesTheSameLogToTheLastBit) {
  for (const char* scenario : {"paper_rigid", "practical_flexible"}) {
    scenario_ = scenario;
    start({"--duration", "0.1", "--run-id", "7", "--quiet"});
    EXPECT_EQ(finish(), 0) << standard_error();
    const std::string log = text_of(out() / "lcmlog");
    fs::remove_all(out());
    start_on_this_network(
        {"--out", out().string(), "--duration", "0.1", "--run-id", "7", "--in-process"});
    EXPECT_EQ(finish(), 0) << standard_error();
    EXPECT_TRUE(text_of(out() / "lcmlog") == log) << scenario;
    EXPECT_EQ(summary()["log"]["gaps"], 0);
    EXPECT_GT(summary()["ticks"], 0);
    EXPECT_TRUE(fs::exists(out() / "report.html"));
    EXPECT_THAT(standard_output(), HasSubstr("ticks/s"));
  }
}

TEST_F(Run, LeavesTheSameLogWhereverItsProcessesExecute) {
  std::set<std::string> logs;
  for (const std::string placement : {"auto", "none"}) {
    start({"--duration", "0.1", "--run-id", "7", "--placement", placement});
    ASSERT_EQ(finish(), 0) << standard_error();
    logs.insert(text_of(out() / "lcmlog"));
    EXPECT_THAT(standard_output(), HasSubstr(summary()["placement"].get<std::string>()));
  }
  EXPECT_EQ(logs.size(), 1U);
  EXPECT_EQ(summary()["placement"], "spread over CPUs");
}

TEST_F(Run, InOneProcessEndsAsFourDo) {
  scenario_ = "iiwa_point_to_point";
  const std::vector<std::string> too_fast = {"--out", out().string(), "--in-process", "--set",
                                             "reference.point_to_point.duration_s=0.1"};
  start_on_this_network(too_fast);
  EXPECT_EQ(finish(), 5);
  EXPECT_THAT(standard_error(), HasSubstr("faster than its limit of"));
  EXPECT_THAT(summary()["fault"].get<std::string>(), HasSubstr("faster than its limit of"));
  logger::RunLog log = logger::RunLog::open(out() / "lcmlog");
  logger::TickRecord record;
  while (log.next(record)) continue;
  ASSERT_EQ(log.summary().faults.size(), 1U);
  EXPECT_THAT(log.summary().faults[0].text, HasSubstr("faster than its limit of"));

  scenario_ = "paper_flexible";
  start_on_this_network({"--out", out().string(), "--in-process"});
  wait_until_running();
  kill(launcher_, SIGINT);
  EXPECT_EQ(finish(), 130);
  EXPECT_EQ(summary()["fault"], "interrupted");
  EXPECT_GT(ticks_of(out() / "lcmlog"), 0);

  start_on_this_network({"--out", out().string(), "--in-process", "--mode", "realtime"});
  EXPECT_EQ(finish(), 2);
  EXPECT_THAT(standard_error(), HasSubstr("type --mode lockstep"));
}

TEST_F(Run, LeavesOtherFilesInItsDirectoryAlone) {
  fs::create_directories(out());
  std::ofstream(out() / "notes.txt") << "mine";
  std::ofstream(out() / "lcmlog") << "an earlier run";
  start({"--duration", "0.01", "--quiet", "--json"});
  EXPECT_EQ(finish(), 0) << standard_error();
  EXPECT_EQ(text_of(out() / "notes.txt"), "mine");
  EXPECT_EQ(ticks_of(out() / "lcmlog"), 200);
  EXPECT_EQ(text_of(out() / "lcmlog.previous"), "an earlier run");
  EXPECT_EQ(nlohmann::json::parse(standard_output()), summary());
}

TEST_F(Run, EndsWithinTwoSecondsWhenAProcessIsKilledAndKeepsTheLog) {
  for (const std::string role : {"controller", "reference", "plant"}) {
    start({"--duration", "1000"});
    wait_until_running();
    const std::optional<pid_t> victim = child("tachless-" + role);
    ASSERT_TRUE(victim.has_value()) << role;
    const auto killed = Clock::now();
    kill(*victim, SIGKILL);
    EXPECT_EQ(finish(), 3) << role << standard_error();
    EXPECT_LT(Clock::now() - killed, seconds(2)) << role;
    EXPECT_THAT(standard_error(), HasSubstr(role + " was killed by signal 9")) << role;
    EXPECT_THAT(summary()["fault"].get<std::string>(), HasSubstr(role + " was killed")) << role;
    EXPECT_GT(ticks_of(out() / "lcmlog"), 100) << role;
    fs::remove_all(out());
  }
}

TEST_F(Run, KeepsTheLogUpToItsLastFlushWhenTheLoggerIsKilled) {
  start({"--duration", "1000"});
  wait_until_running();
  const std::optional<pid_t> victim = child("tachless-logger");
  ASSERT_TRUE(victim.has_value());
  kill(*victim, SIGKILL);
  EXPECT_EQ(finish(), 3) << standard_error();
  EXPECT_THAT(standard_error(), HasSubstr("logger was killed by signal 9"));
  EXPECT_GT(summary()["ticks"].get<int>(), 100);
}

TEST_F(Run, EndsCleanlyOnCtrlC) {
  start({"--duration", "1000"});
  wait_until_running();
  const auto interrupted = Clock::now();
  kill(launcher_, SIGINT);
  EXPECT_EQ(finish(), 130) << standard_error();
  EXPECT_LT(Clock::now() - interrupted, seconds(2));
  EXPECT_EQ(summary()["fault"], "interrupted");
  EXPECT_THAT(standard_output(),
              HasSubstr(std::to_string(summary()["ticks"].get<int>()) + " of 20000000 ticks"));
  EXPECT_EQ(summary()["log"]["gaps"], 0);
  EXPECT_GT(ticks_of(out() / "lcmlog"), 100);
}

std::size_t count(const std::string& text, const std::string& word) {
  std::size_t found = 0;
  for (std::size_t at = 0; (at = text.find(word, at)) != std::string::npos; ++at) ++found;
  return found;
}

TEST_F(Run, TellsTheFirstCauseOnceAndWhoElseEnded) {
  start({"--duration", "1000"});
  wait_until_running();
  kill(child("tachless-controller").value_or(0), SIGKILL);
  EXPECT_EQ(finish(), 3);
  const std::string errors = standard_error();
  EXPECT_EQ(count(errors, "controller was killed by signal 9"), 1U) << errors;
  EXPECT_EQ(count(errors, "ended because of"), 0U) << errors;
}

TEST_F(Run, EndsWhenItsLogIsRemovedReplacedOrCut) {
  const std::vector<std::pair<std::string, void (*)(const fs::path&)>> acts = {
      {"was removed", [](const fs::path& log) { fs::remove(log); }},
      {"was replaced",
       [](const fs::path& log) {
         fs::remove(log);
         std::ofstream(log) << "another";
       }},
      {"bytes long and has", [](const fs::path& log) { fs::resize_file(log, 0); }}};
  for (const auto& [said, act] : acts) {
    start({"--duration", "1000", "--quiet"});
    wait_until_running();
    act(out() / "lcmlog");
    EXPECT_EQ(finish(), 2) << standard_error();
    EXPECT_EQ(count(standard_error(), said), 1U) << standard_error();
    fs::remove_all(out());
  }
}

TEST_F(Run, NeedsNoDirectoryForTemporaryFiles) {
  setenv("TMPDIR", "/missing", 1);
  start({"--duration", "0.01"});
  unsetenv("TMPDIR");
  EXPECT_EQ(finish(), 0) << standard_error();
  EXPECT_THAT(text_of(out() / "report.html"), HasSubstr("</html>"));
}

/// Loops that are unstable, but stay within torques that a robot has.
TEST_F(Run, OfAnUnstableLoopIsRefusedAndWhenForcedEndsWithItsVerdict) {
  const struct {
    const char *scenario, *verdict;
    std::vector<std::string> settings;
  } cases[] = {
      {"practical_rigid",
       "saturated",
       {"loop.period_s=4e-3", "plant.drive.torque_limit_Nm=[300, 100]"}},
      {"practical_flexible",
       "saturated",
       {"loop.period_s=5e-3", "plant.drive.torque_limit_Nm=[400, 200]"}},
      {"regulation",
       "limit cycle",
       {"loop.period_s=5e-3", "loop.command_delay=1", "plant.drive.torque_limit_Nm=[2000, 500]"}},
      {"iiwa_point_to_point",
       "limit cycle",
       {"controller.gains.kd=[400, 1000, 80, 300, 8, 12, 0.5]",
        "controller.gains.b=[400, 400, 400, 400, 400, 400, 400]"}}};
  for (const auto& each : cases) {
    SCOPED_TRACE(each.scenario);
    scenario_ = each.scenario;
    std::vector<std::string> arguments = {"--duration", "1", "--set", "plant.on_limit=warn"};
    for (const std::string& setting : each.settings) {
      arguments.insert(arguments.end(), {"--set", setting});
    }
    start(arguments);
    EXPECT_EQ(finish(), 2);
    EXPECT_THAT(standard_error(),
                AllOf(HasSubstr("unstable at"), HasSubstr("largest stable period"),
                      HasSubstr("type --set loop.period_s="), HasSubstr("--force")));
    EXPECT_FALSE(fs::exists(out() / "lcmlog"));
    arguments.emplace_back("--force");
    start(arguments);
    EXPECT_EQ(finish(), 1) << standard_error();
    EXPECT_THAT(summary()["verdict"].get<std::string>(), HasSubstr(each.verdict));
    EXPECT_THAT(standard_output(), HasSubstr(each.verdict));
    fs::remove_all(out());
  }
}

TEST_F(Run, EndsWithCode5AndNoInternalErrorWhenTheSquareOfTheErrorOverflows) {
  start({"--duration", "0.01", "--set", "plant.initial.position_rad=[1e155, 0]"});
  EXPECT_EQ(finish(), 5) << standard_error();
  EXPECT_EQ(count(standard_error(), "internal error"), 0U) << standard_error();
}

TEST_F(Run, BesideAnotherOneIsRefusedNamingIsolateAndTouchesNothing) {
  const fs::path second = directory_ / "second";
  fs::create_directories(second);
  std::ofstream(second / "summary.json") << "earlier";
  start_on_this_network({"--out", out().string(), "--duration", "1000"});
  wait_until_running();
  const pid_t first = launcher_;
  start_on_this_network({"--out", second.string(), "--duration", "0.01"});
  EXPECT_EQ(finish(), 4);
  EXPECT_THAT(standard_error(), AllOf(HasSubstr("there is already the"), HasSubstr("--isolate")));
  EXPECT_EQ(count(standard_error(), "\n"), 1U) << standard_error();
  EXPECT_EQ(standard_output(), "") << "no table of what did not happen";
  EXPECT_EQ(text_of(second / "summary.json"), "earlier");
  launcher_ = first;
  kill(launcher_, SIGINT);
  EXPECT_EQ(finish(), 130);
}

TEST_F(Run, StartedAtTheSameTimeAsAnotherIsRefusedNamingIsolateToo) {
  const auto command = [&](const std::string& name) {
    const std::string out = directory_ / name;
    return TACHLESS_BINARY_DIR "/bin/tachless run " TACHLESS_SOURCE_DIR
                               "/scenarios/paper_rigid.yaml --duration 0.5 --quiet --out " +
           out + " 2> " + out + ".err";
  };
  ASSERT_EQ(std::system((command("one") + " & " + command("two") + "; wait").c_str()), 0);
  const std::string errors = text_of(directory_ / "one.err") + text_of(directory_ / "two.err");
  EXPECT_THAT(errors, AllOf(HasSubstr("end it first"), HasSubstr("--isolate")));
}

TEST_F(Run, ThatDoesNotBeginLeavesTheFilesOfAnEarlierOne) {
  start({"--duration", "0.01", "--quiet"});
  ASSERT_EQ(finish(), 0) << standard_error();
  const auto earlier = files_in(out());
  ASSERT_EQ(earlier.size(), 4U);
  start({"--duration", "0.01", "--quiet"});
  const auto until = Clock::now() + seconds(30);
  std::optional<pid_t> plant;
  while (!plant && Clock::now() < until) plant = child("tachless-plant");
  kill(plant.value_or(0), SIGKILL);
  EXPECT_EQ(finish(), 3) << standard_error();
  EXPECT_TRUE(files_in(out()) == earlier) << standard_error();
  EXPECT_EQ(standard_output(), "");
}

TEST_F(Run, IsNotEndedByCode0WhenAResultCannotBeWritten) {
  fs::create_directories(out() / "summary.json.partial");
  start({"--duration", "0.01", "--any-verdict"});
  EXPECT_EQ(finish(), 2);
  EXPECT_EQ(count(standard_error(), "summary.json: cannot be written"), 1U) << standard_error();
  EXPECT_THAT(standard_output(), HasSubstr("200 ticks")) << "the run itself is told all the same";
}

TEST_F(Run, EndsCleanlyOnEverySignalThatEndsIt) {
  for (const int signal : {SIGHUP, SIGQUIT, SIGPIPE, SIGTERM, SIGUSR1, SIGALRM}) {
    start({"--duration", "1000", "--quiet"});
    wait_until_running();
    kill(launcher_, signal);
    EXPECT_EQ(finish(), 130) << strsignal(signal) << standard_error();
    EXPECT_EQ(summary()["fault"], "interrupted") << strsignal(signal);
    fs::remove_all(out());
  }
}

TEST_F(Run, RefusesADirectoryThatAnotherRunWritesTo) {
  start({"--duration", "1000"});
  wait_until_running();
  const pid_t first = launcher_;
  start({"--duration", "0.01"});
  EXPECT_EQ(finish(), 2);
  EXPECT_THAT(standard_error(), HasSubstr("another run is writing there"));
  launcher_ = first;
  kill(launcher_, SIGINT);
  EXPECT_EQ(finish(), 130);
}

}  // namespace

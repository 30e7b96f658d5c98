// `tachless run` as a user runs it: four real processes in a private network.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <fmt/format.h>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "base/json_text.h"
#include "bus/udp_transport.h"
#include "logger/run_log.h"
#include "messages/wire.h"
#include "tests/support/program.h"

namespace tachless::run_test {
namespace {

namespace fs = std::filesystem;
using std::chrono::seconds;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using Clock = std::chrono::steady_clock;
using Words = std::vector<std::string>;

std::size_t count(const std::string& text, const std::string& word) {
  std::size_t found = 0;
  for (std::size_t at = 0; (at = text.find(word, at)) != std::string::npos; ++at) ++found;
  return found;
}

std::int64_t ticks_of(const fs::path& path) {
  logger::RunLog log = logger::RunLog::open(path);
  logger::TickRecord record;
  std::int64_t ticks = 0;
  while (log.next(record)) ++ticks;
  EXPECT_FALSE(log.damage().any());
  return ticks;
}

class Run : public ::testing::Test {
 protected:
  /// The plant as a user's program, after `command` in the results' folder.
  std::string plant_after(const std::string& command) {
    return fmt::format(
        "sh -c 'cd {} && {} && cd - >/dev/null && exec {}/bin/tachless-plant \"$@\"' sh",
        out().string(), command, TACHLESS_BINARY_DIR);
  }
  /// In a private network, results in `out()`.
  void start(Words more) {
    more.insert(more.begin(), {"--out", out().string()});
    setenv("TACHLESS_ISOLATE", "1", 1);  // --isolate refuses --plant
    start_anywhere(more);
    unsetenv("TACHLESS_ISOLATE");
  }
  void start_anywhere(const Words& more) { run_ = launch(more); }
  std::unique_ptr<Program> launch(const Words& more) {
    Words words = {"run", TACHLESS_SOURCE_DIR "/scenarios/" + scenario_ + ".yaml"};
    words.insert(words.end(), more.begin(), more.end());
    return std::make_unique<Program>("tachless", words, directory_.path());
  }
  int finish() { return run_->wait(); }
  void stop(int signal) { run_->signal(signal); }

  /// The process of that program that the launcher started; 0: none.
  [[nodiscard]] pid_t child(const std::string& program) const {
    const std::string pid = std::to_string(run_->pid());
    std::istringstream pids(contents("/proc/" + pid + "/task/" + pid + "/children"));
    for (pid_t each = 0; pids >> each;) {
      const std::string command = contents("/proc/" + std::to_string(each) + "/cmdline");
      if (command.find(program) != std::string::npos) return each;
    }
    return 0;
  }
  void kill_process(const std::string& role) const {
    const pid_t victim = child("tachless-" + role);
    ASSERT_GT(victim, 0) << role;
    kill(victim, SIGKILL);
  }

  /// Until the log has grown to some thousand ticks.
  void wait_until_running() {
    wait_until("the run to get going", [&] {
      if (!run_->running()) throw std::runtime_error(run_->errors());
      std::error_code error;
      const auto size = fs::file_size(out() / "lcmlog", error);
      return !error && size > 500'000;
    });
  }

  [[nodiscard]] fs::path out() const { return directory_ / "out"; }
  [[nodiscard]] std::string errors() const { return run_->errors(); }
  [[nodiscard]] std::string output() const { return run_->output(); }
  [[nodiscard]] nlohmann::json summary() const {
    return base::parse_json(contents(out() / "summary.json"));
  }
  /// Returns why the run was stopped, as its log says.
  std::string stop_reason() const {
    logger::RunLog log = logger::RunLog::open(out() / "lcmlog");
    logger::TickRecord record;
    while (log.next(record)) continue;
    return log.summary().stop_reason(log.info().num_ticks);
  }

  TemporaryDirectory directory_;
  std::string scenario_ = "paper_rigid";
  std::unique_ptr<Program> run_;
};

TEST_F(Run, CompletesWithoutAGapAndLeavesLogSummaryAndFigure) {
  start({"--duration", "0.1", "--run-id", "7"});
  EXPECT_EQ(finish(), 0) << errors();
  const nlohmann::json result = summary();
  EXPECT_EQ(result["ticks"], 2000);
  EXPECT_EQ(result["run_id"], 7);
  EXPECT_EQ(result["log"]["gaps"], 0);
  EXPECT_EQ(result["log"]["ticks"], 2000);
  EXPECT_TRUE(result["fault"].is_null());
  EXPECT_EQ(result["position_error_rad"]["peak"].size(), 2U);
  EXPECT_EQ(ticks_of(out() / "lcmlog"), 2000);
  EXPECT_THAT(contents(out() / "tracking.svg"), HasSubstr("</svg>"));
  EXPECT_THAT(contents(out() / "report.html"),
              AllOf(HasSubstr("</html>"), HasSubstr("<figure id=\"round-trip\"")));
  EXPECT_THAT(output(), AllOf(HasSubstr("position error"), HasSubstr("log gaps 0"),
                              HasSubstr((out() / "tracking.svg").string())));
  std::set<std::string> files;
  for (const auto& entry : fs::directory_iterator(out())) files.insert(entry.path().filename());
  EXPECT_EQ(files,
            (std::set<std::string>{"lcmlog", "report.html", "summary.json", "tracking.svg"}));
}

TEST_F(Run, InOneProcessLeavesTheSameLogToTheLastBit) {
  for (const char* scenario : {"paper_rigid", "practical_flexible"}) {
    scenario_ = scenario;
    start({"--duration", "0.1", "--run-id", "7", "--quiet", "--overwrite"});
    EXPECT_EQ(finish(), 0) << errors();
    const std::string log = contents(out() / "lcmlog");
    start_anywhere({"--out", out().string(), "--duration", "0.1", "--run-id", "7", "--in-process",
                    "--overwrite"});
    EXPECT_EQ(finish(), 0) << errors();
    EXPECT_TRUE(contents(out() / "lcmlog") == log) << scenario;
    EXPECT_EQ(summary()["log"]["gaps"], 0);
    EXPECT_TRUE(fs::exists(out() / "report.html"));
    EXPECT_THAT(output(), HasSubstr("ticks/s"));
  }
}

TEST_F(Run, OfATableLeavesFigureAndPageAndReportReadsItsLog) {
  const fs::path table = directory_ / "two.csv";
  std::ofstream(table) << "0,0,0\n5,0,0\n";
  scenario_ = "practical_rigid";
  start_anywhere({"--out", out().string(), "--duration", "0.1", "--in-process", "--set",
                  "reference={file: '" + table.string() + "'}"});
  EXPECT_EQ(finish(), 0) << errors();
  EXPECT_THAT(output(), HasSubstr("position error"));
  EXPECT_TRUE(fs::exists(out() / "tracking.svg") && fs::exists(out() / "report.html"));
  Program report("tachless", {"report", out().string(), "-o", (directory_ / "a.html").string()},
                 directory_.path());
  EXPECT_EQ(report.wait(), 0) << report.errors();
}

TEST_F(Run, LeavesTheSameLogWhereverItsProcessesExecute) {
  std::set<std::string> logs;
  for (const std::string placement : {"auto", "none"}) {
    start({"--duration", "0.1", "--run-id", "7", "--placement", placement, "--overwrite"});
    ASSERT_EQ(finish(), 0) << errors();
    logs.insert(contents(out() / "lcmlog"));
    EXPECT_THAT(output(), HasSubstr(summary()["placement"].get<std::string>()));
  }
  EXPECT_EQ(logs.size(), 1U);
  EXPECT_EQ(summary()["placement"], "spread over CPUs");
}

TEST_F(Run, InOneProcessDoesNotMindABusInTheEnvironment) {
  setenv("LCM_DEFAULT_URL", "udpm://239.255.76.67:7667?ttl=0", 1);
  start_anywhere({"--out", out().string(), "--in-process", "--duration", "0.01"});
  EXPECT_EQ(finish(), 0) << errors();
  unsetenv("LCM_DEFAULT_URL");
}

TEST_F(Run, InOneProcessEndsAsFourDo) {
  scenario_ = "iiwa_point_to_point";
  start_anywhere({"--out", out().string(), "--in-process", "--set",
                  "reference.point_to_point.duration_s=0.1"});
  EXPECT_EQ(finish(), 5);
  EXPECT_THAT(errors(), HasSubstr("faster than its limit of"));
  EXPECT_THAT(summary()["fault"].get<std::string>(), HasSubstr("faster than its limit of"));
  logger::RunLog log = logger::RunLog::open(out() / "lcmlog");
  logger::TickRecord record;
  while (log.next(record)) continue;
  ASSERT_EQ(log.summary().faults.size(), 1U);
  EXPECT_THAT(log.summary().faults[0].text, HasSubstr("faster than its limit of"));
  fs::remove_all(out());

  scenario_ = "paper_flexible";
  start_anywhere({"--out", out().string(), "--in-process"});
  wait_until_running();
  stop(SIGINT);
  EXPECT_EQ(finish(), 130);
  EXPECT_EQ(summary()["fault"], "interrupted");
  EXPECT_GT(ticks_of(out() / "lcmlog"), 0);
  EXPECT_EQ(stop_reason(), "interrupted");
  fs::remove_all(out());

  start_anywhere({"--out", out().string(), "--in-process", "--mode", "realtime"});
  EXPECT_EQ(finish(), 2);
  EXPECT_THAT(errors(), HasSubstr("type --mode lockstep"));
}

TEST_F(Run, WritesIntoADirectoryOfItsTimeAndLinksTheLatest) {
  const fs::path runs = directory_ / "out/paper_rigid";
  ASSERT_EQ(chdir(directory_.path().c_str()), 0);
  const Words words = {"--in-process", "--duration", "0.01", "--quiet"};
  std::vector<fs::path> found;
  for (int i = 0; i < 2; ++i) {
    start_anywhere(words);
    EXPECT_EQ(finish(), 0) << errors();
    found.push_back(runs / fs::read_symlink(runs / "latest"));
    EXPECT_EQ(ticks_of(found.back() / "lcmlog"), 200);
  }
  EXPECT_NE(found[0], found[1]);
  EXPECT_EQ(ticks_of(found[0] / "lcmlog"), 200) << "the first run's results stay";
  start_anywhere({"--in-process", "--duration", "0.01", "--controller", "false"});
  EXPECT_NE(finish(), 0);
  EXPECT_EQ(runs / fs::read_symlink(runs / "latest"), found[1]);
  EXPECT_EQ(std::distance(fs::directory_iterator(runs), fs::directory_iterator()), 3)
      << "a run that does not begin leaves nothing";
  start_anywhere({"--in-process", "--duration", "0.01", "--out", "out/paper_rigid"});
  EXPECT_EQ(finish(), 2);
  EXPECT_THAT(errors(), HasSubstr("holds the runs of a scenario"));
}

TEST_F(Run, ReplacesResultsOnlyWhenForcedAndLeavesOtherFilesAlone) {
  fs::create_directories(out());
  std::ofstream(out() / "notes.txt") << "mine";
  std::ofstream(out() / "lcmlog") << "an earlier run";
  const Words words = {"--out", out().string(), "--in-process", "--duration", "0.01", "--json"};
  start_anywhere(words);
  EXPECT_EQ(finish(), 2);
  EXPECT_THAT(errors(), AllOf(HasSubstr("lcmlog of an earlier run"), HasSubstr("--overwrite")));
  EXPECT_EQ(count(errors(), "\n"), 1U);
  EXPECT_EQ(contents(out() / "lcmlog"), "an earlier run");
  Words forced = words;
  forced.emplace_back("--overwrite");
  start_anywhere(forced);
  EXPECT_EQ(finish(), 0) << errors();
  EXPECT_EQ(contents(out() / "notes.txt"), "mine");
  EXPECT_EQ(ticks_of(out() / "lcmlog"), 200);
  EXPECT_EQ(base::parse_json(output()), summary());
  EXPECT_FALSE(fs::exists(out() / ".earlier-lcmlog"));

  fs::remove(out() / "report.html");
  fs::create_directories(out() / "report.html/mine");
  start_anywhere(forced);
  EXPECT_EQ(finish(), 2);
  EXPECT_THAT(errors(), HasSubstr("report.html there is a directory"));
}

TEST_F(Run, EndsWhenAProcessIsKilledAndKeepsTheLog) {
  for (const std::string role : {"controller", "reference", "plant"}) {
    start({"--duration", "1000"});
    wait_until_running();
    const auto killed = Clock::now();
    kill_process(role);
    EXPECT_EQ(finish(), 3) << role << errors();
    EXPECT_LT(Clock::now() - killed, seconds(60)) << role;
    EXPECT_EQ(count(errors(), role + " was killed by signal 9"), 1U) << errors();
    EXPECT_EQ(count(errors(), "ended because of"), 0U) << errors();
    EXPECT_THAT(summary()["fault"].get<std::string>(), HasSubstr(role + " was killed")) << role;
    EXPECT_GT(ticks_of(out() / "lcmlog"), 100) << role;
    EXPECT_THAT(stop_reason(), HasSubstr(role + " was killed by signal 9"));
    fs::remove_all(out());
  }
}

TEST_F(Run, KeepsTheLogUpToItsLastFlushWhenTheLoggerIsKilled) {
  start({"--duration", "1000"});
  wait_until_running();
  kill_process("logger");
  EXPECT_EQ(finish(), 3) << errors();
  EXPECT_THAT(errors(), HasSubstr("logger was killed by signal 9"));
  EXPECT_GT(summary()["ticks"].get<int>(), 100);
}

TEST_F(Run, ThatDoctorStartsPassesItsInterruptionOn) {
  setenv("TMPDIR", directory_.path().c_str(), 1);
  fs::current_path(directory_.path());
  run_ = std::make_unique<Program>(
      "tachless",
      Words{"doctor", "--scenario", TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml",
            "--seconds", "1000"},
      directory_.path());
  unsetenv("TMPDIR");
  wait_until("the run's first ticks", [&] {
    if (!run_->running()) throw std::runtime_error(run_->errors());
    for (const auto& made : fs::directory_iterator(directory_.path())) {
      std::error_code missing;
      if (fs::file_size(made.path() / "run/lcmlog", missing) > 0 && !missing) return true;
    }
    return false;
  });
  stop(SIGINT);
  EXPECT_EQ(finish(), 130) << errors();
  EXPECT_THAT(errors(), HasSubstr("its run was interrupted"));
}

TEST_F(Run, EndsCleanlyOnEverySignalThatEndsIt) {
  for (const int signal : {SIGINT, SIGHUP, SIGQUIT, SIGPIPE, SIGTERM}) {
    start({"--duration", "1000"});
    wait_until_running();
    const auto interrupted = Clock::now();
    stop(signal);
    EXPECT_EQ(finish(), 130) << strsignal(signal) << errors();
    EXPECT_LT(Clock::now() - interrupted, seconds(60));
    EXPECT_EQ(summary()["fault"], "interrupted") << strsignal(signal);
    EXPECT_EQ(summary()["log"]["gaps"], 0);
    EXPECT_THAT(output(),
                HasSubstr(std::to_string(summary()["ticks"].get<int>()) + " of 20000000 ticks"));
    fs::remove_all(out());
  }
}

TEST_F(Run, EndsWithCode2WhenItsLogWasRemovedOrReplaced) {
  const std::vector<std::pair<std::string, void (*)(const fs::path&)>> acts = {
      {"was removed", [](const fs::path& log) { fs::remove(log); }},
      {"was replaced", [](const fs::path& log) {
         fs::remove(log);
         std::ofstream(log) << "another";
       }}};
  for (const auto& [expected, act] : acts) {
    start({"--duration", "0.5", "--quiet"});
    wait_until_running();
    act(out() / "lcmlog");
    EXPECT_EQ(finish(), 2) << errors();
    EXPECT_EQ(count(errors(), expected), 1U) << errors();
    fs::remove_all(out());
  }
}

TEST_F(Run, NeedsNoDirectoryForTemporaryFiles) {
  setenv("TMPDIR", "/missing", 1);
  start({"--duration", "0.01"});
  unsetenv("TMPDIR");
  EXPECT_EQ(finish(), 0) << errors();
  EXPECT_THAT(contents(out() / "report.html"), HasSubstr("</html>"));
}

/// Loops that are unstable, but stay within torques that a robot has.
TEST_F(Run, OfAnUnstableLoopIsRefusedAndWhenForcedEndsWithItsVerdict) {
  const struct {
    const char *scenario, *verdict;
    Words settings;
  } cases[] = {
      {"practical_flexible",
       "saturated",
       {"loop.period_s=5e-3", "plant.drive.torque_limit_Nm=[400, 200]"}},
      {"regulation",
       "oscillates",
       {"loop.period_s=5e-3", "loop.command_delay=1", "plant.drive.torque_limit_Nm=[2000, 500]"}},
      {"iiwa_point_to_point",
       "oscillates",
       {"controller.gains.kd=[400, 1000, 80, 300, 8, 12, 0.5]",
        "controller.gains.b=[400, 400, 400, 400, 400, 400, 400]"}}};
  for (const auto& each : cases) {
    SCOPED_TRACE(each.scenario);
    scenario_ = each.scenario;
    Words words = {"--duration", "1", "--set", "plant.on_limit=warn"};
    for (const std::string& setting : each.settings) {
      words.insert(words.end(), {"--set", setting});
    }
    start(words);
    EXPECT_EQ(finish(), 2);
    EXPECT_THAT(errors(), AllOf(HasSubstr("unstable at"), HasSubstr("largest stable period"),
                                HasSubstr("type --set loop.period_s="), HasSubstr("--force")));
    EXPECT_FALSE(fs::exists(out() / "lcmlog"));
    words.emplace_back("--force");
    start(words);
    EXPECT_EQ(finish(), 1) << errors();
    EXPECT_THAT(summary()["verdict"].get<std::string>(), HasSubstr(each.verdict));
    EXPECT_THAT(output(), HasSubstr(each.verdict));
    fs::remove_all(out());
  }
}

TEST_F(Run, EndsWithCode5AndNoInternalErrorWhenTheSquareOfTheErrorOverflows) {
  start({"--duration", "0.01", "--set", "plant.initial.position_rad=[1e155, 0]"});
  EXPECT_EQ(finish(), 5) << errors();
  EXPECT_EQ(count(errors(), "internal error"), 0U) << errors();
}

TEST_F(Run, BesideAnotherOneIsRefusedNamingIsolateAndTouchesNothing) {
  start_anywhere({"--out", out().string(), "--duration", "1000"});
  wait_until_running();
  const fs::path second = directory_ / "second";
  const auto other = launch({"--out", second.string(), "--duration", "0.01"});
  EXPECT_EQ(other->wait(), 4);
  EXPECT_THAT(other->errors(), AllOf(HasSubstr("there is already the"), HasSubstr("--isolate")));
  EXPECT_EQ(count(other->errors(), "\n"), 1U) << other->errors();
  EXPECT_EQ(other->output(), "") << "no table of what did not happen";
  EXPECT_FALSE(fs::exists(second));
  const auto there = launch({"--isolate", "--out", out().string(), "--duration", "0.01"});
  EXPECT_EQ(there->wait(), 2);
  EXPECT_THAT(there->errors(), HasSubstr("another run is writing there"));
  stop(SIGINT);
  EXPECT_EQ(finish(), 130);
}

TEST_F(Run, StartedAtTheSameTimeAsAnotherIsRefusedNamingIsolateToo) {
  const auto one = launch({"--duration", "0.5", "--quiet", "--out", directory_ / "one"});
  const auto two = launch({"--duration", "0.5", "--quiet", "--out", directory_ / "two"});
  one->wait();
  two->wait();
  EXPECT_THAT(one->errors() + two->errors(),
              AllOf(HasSubstr("end it first"), HasSubstr("--isolate")));
}

TEST_F(Run, ThatDoesNotBeginLeavesNothing) {
  // A controller that answers before the run and not in it, which cannot begin before the plant is
  // killed.
  start({"--duration", "0.01", "--quiet", "--controller",
         "sh -c 'case \"$*\" in *--serve*) exec " TACHLESS_BINARY_DIR
         "/bin/tachless-own-law \"$@\";; esac; exec sleep 1000' sh"});
  wait_until("the plant to start", [&] { return child("tachless-plant") > 0; });
  kill_process("plant");
  EXPECT_EQ(finish(), 3) << errors();
  EXPECT_FALSE(fs::exists(out())) << errors();
  EXPECT_EQ(output(), "");
}

TEST_F(Run, ThatDoesNotBeginLeavesTheResultsThatItWouldHaveReplaced) {
  fs::create_directories(out());
  for (const char* file : {"lcmlog", "summary.json", "notes.txt"})
    std::ofstream(out() / file) << file;
  start({"--duration", "0.01", "--quiet", "--overwrite", "--plant", "/nowhere/driver"});
  EXPECT_EQ(finish(), 2) << errors();
  std::set<std::string> files;
  for (const auto& each : fs::directory_iterator(out())) files.insert(each.path().filename());
  EXPECT_THAT(files, ElementsAre("lcmlog", "notes.txt", "summary.json"));
  for (const std::string& file : files) EXPECT_EQ(contents(out() / file), file);
}

TEST_F(Run, FindsWhatARunThatWasKilledBeforeItBeganHasPutAside) {
  fs::create_directories(out());
  std::ofstream(out() / ".earlier-lcmlog") << "an earlier run";
  start_anywhere({"--out", out().string(), "--in-process", "--duration", "0.01"});
  EXPECT_EQ(finish(), 2);
  EXPECT_THAT(errors(), HasSubstr("lcmlog of an earlier run"));
  EXPECT_EQ(contents(out() / "lcmlog"), "an earlier run");
}

TEST_F(Run, IsNotKeptFromStartingByOneRecordedAnnouncement) {
  bus::UdpTransport transport;
  messages::Codec<messages::Participant> codec(messages::Layout{});
  messages::Participant plant;
  plant.instance = plant.counter = 5;
  start_anywhere({"--duration", "0.01", "--quiet", "--out", out().string()});
  while (run_->running()) {
    transport.publish("ARM_PARTICIPANT", codec.encode({1'000'000, 7, -1}, plant));
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  EXPECT_EQ(finish(), 0) << errors();
}

TEST_F(Run, OfAControllerThatCannotStartEndsWithCode2) {
  for (const char* program : {"/nowhere/law", "python3 -c 'import missing_module'"}) {
    start({"--duration", "0.01", "--quiet", "--controller", program});
    EXPECT_EQ(finish(), 2) << program << errors();
  }
}

TEST_F(Run, IsNotEndedByCode0WhenAResultCannotBeWritten) {
  start({"--duration", "0.01", "--any-outcome", "--plant", plant_after("mkdir summary.json")});
  EXPECT_EQ(finish(), 2);
  EXPECT_EQ(count(errors(), "summary.json: cannot be written"), 1U) << errors();
  EXPECT_THAT(output(), HasSubstr("200 ticks")) << "the table is printed nevertheless";
}

TEST_F(Run, IsNotEndedByItsFigureOrItsPage) {
  start({"--duration", "0.01", "--any-outcome", "--plant",
         plant_after("mkdir tracking.svg report.html")});
  EXPECT_EQ(finish(), 0) << errors();
  EXPECT_EQ(count(errors(), "tracking.svg: cannot be written"), 1U) << errors();
  EXPECT_EQ(count(errors(), "report.html: cannot be written"), 1U) << errors();
  EXPECT_EQ(count(errors(), "-o;"), 0U) << "an option of tachless report: " << errors();
  EXPECT_TRUE(fs::exists(out() / "summary.json"));
}

}  // namespace
}  // namespace tachless::run_test

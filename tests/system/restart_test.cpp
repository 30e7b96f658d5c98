// A controller that is killed in mid-run and succeeded: the same log to the last bit, or a clear
// word why not.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "logger/run_log.h"
#include "tests/support/packet_loss.h"
#include "tests/support/private_network.h"
#include "tests/support/process_facts.h"
#include "tests/support/program.h"
#include "tests/system/four_programs.h"

using namespace tachless;

namespace {

namespace fs = std::filesystem;
using system_test::FourPrograms;
using system_test::scenarios;
using ::testing::AllOf;
using ::testing::HasSubstr;

std::uintmax_t size_of(const fs::path& file) {
  std::error_code absent;
  const auto size = fs::file_size(file, absent);
  return absent ? 0 : size;
}

/// `tachless run`, with what it is given besides.
class Launched {
 public:
  Launched(const std::string& scenario, const std::vector<std::string>& more)
      : run_("tachless", arguments(scenario, more), directory_.path()) {}

  /// Kills the controller as soon as the log is so long. @return whether it was still needed
  bool kill_controller_at(std::uintmax_t log_bytes) {
    while (size_of(log_path()) < log_bytes) {
      if (!run_.running()) return false;
      std::this_thread::yield();
    }
    const pid_t controller = find("tachless-controller");
    return controller > 0 && kill(controller, SIGKILL) == 0;
  }
  /// Kills it when it has just been started.
  void kill_controller_at_once() {
    pid_t controller = 0;
    while (controller == 0) controller = find("tachless-controller");
    kill(controller, SIGKILL);
  }

  int wait() { return run_.wait(std::chrono::seconds(120)); }
  [[nodiscard]] std::string errors() const { return run_.errors(); }
  [[nodiscard]] fs::path log_path() const { return directory_ / "out/lcmlog"; }
  [[nodiscard]] std::string log() const { return contents(log_path()); }
  [[nodiscard]] nlohmann::json summary() const {
    return nlohmann::json::parse(contents(directory_ / "out/summary.json"));
  }

 private:
  std::vector<std::string> arguments(const std::string& scenario,
                                     const std::vector<std::string>& more) const {
    std::vector<std::string> all{"run",   scenarios + scenario,         "--quiet", "--run-id", "7",
                                 "--out", (directory_ / "out").string()};
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }

  /// The launcher's child that runs this program; 0: none.
  [[nodiscard]] pid_t find(const std::string& program) const {
    for (const pid_t pid : support::children_of(run_.pid())) {
      if (support::program_of(pid) == program) return pid;
    }
    return 0;
  }

  TemporaryDirectory directory_;
  Program run_;
};

struct Case {
  const char* scenario;
  const char* duration_s;
};

class ARestartedController : public ::testing::TestWithParam<Case> {};

TEST_P(ARestartedController, LeavesTheLogOfARunThatNothingHappenedTo) {
  const std::vector<std::string> duration = {"--duration", GetParam().duration_s};
  Launched clean(GetParam().scenario, duration);
  ASSERT_EQ(clean.wait(), 0) << clean.errors();
  const std::string log = clean.log();
  ASSERT_FALSE(log.empty());

  Launched killed(GetParam().scenario,
                  {"--duration", GetParam().duration_s, "--restart", "controller"});
  killed.kill_controller_at_once();
  int kills = 1;
  for (const double part : {0.0001, 0.2, 0.5}) {
    kills += killed.kill_controller_at(
                 static_cast<std::uintmax_t>(part * static_cast<double>(log.size())))
                 ? 1
                 : 0;
  }
  EXPECT_EQ(killed.wait(), 0) << killed.errors();
  EXPECT_EQ(kills, 4);
  EXPECT_TRUE(killed.log() == log);
  EXPECT_GE(killed.summary()["takeovers"], 2) << "at the rendezvous nobody is succeeded";
  EXPECT_THAT(killed.errors(), AllOf(HasSubstr("controller was killed by signal 9"),
                                     HasSubstr("has taken the place of one that is silent")));
}

INSTANTIATE_TEST_SUITE_P(Scenarios, ARestartedController,
                         ::testing::Values(Case{"paper_rigid.yaml", "1"},
                                           Case{"paper_flexible.yaml", "0.5"},
                                           Case{"practical_rigid.yaml", "10"}),
                         [](const auto& each) {
                           const std::string file = each.param.scenario;
                           return file.substr(0, file.find('.'));
                         });

TEST(ARestartedController, LeavesTheSameLogWhenPacketsAreLostToo) {
  Launched clean("practical_rigid.yaml", {"--duration", "4"});
  ASSERT_EQ(clean.wait(), 0) << clean.errors();
  const support::PacketLoss loss(30);
  Launched killed("practical_rigid.yaml", {"--duration", "4", "--restart", "controller"});
  EXPECT_TRUE(killed.kill_controller_at(100'000));
  EXPECT_TRUE(killed.kill_controller_at(1'500'000));
  EXPECT_EQ(killed.wait(), 0) << killed.errors();
  EXPECT_TRUE(killed.log() == clean.log());
}

TEST(ARestartedController, ResumesOnABusWithAKey) {
  const TemporaryDirectory directory;
  const std::string key = directory / "key";
  std::ofstream(key) << std::string(64, '5');
  chmod(key.c_str(), 0600);
  Launched clean("practical_rigid.yaml", {"--duration", "4"});
  ASSERT_EQ(clean.wait(), 0) << clean.errors();
  Launched killed("practical_rigid.yaml",
                  {"--duration", "4", "--restart", "controller", "--key-file", key});
  EXPECT_TRUE(killed.kill_controller_at(1'000'000));
  EXPECT_EQ(killed.wait(), 0) << killed.errors();
  EXPECT_TRUE(killed.log() == clean.log());
}

/// paper_rigid by hand, killed in mid-run; long enough never to end by itself.
class ByHand : public ::testing::Test {
 protected:
  void start_and_kill_controller() {
    run.settings = {"--set", "loop.duration_s=1000"};
    start();
    run["controller"].signal(SIGKILL);
    run["controller"].wait();
  }
  void start() {
    run.start_all();
    while (run.log_size() < 1'000'000) {
      ASSERT_TRUE(run["plant"].running()) << run["plant"].errors();
    }
  }
  FourPrograms run{"paper_rigid.yaml"};
};

TEST_F(ByHand, ResumesWhenAnotherControllerIsStarted) {
  std::string clean;
  {
    FourPrograms undisturbed("paper_rigid.yaml");
    undisturbed.settings = {"--set", "loop.duration_s=1"};
    undisturbed.start_all();
    undisturbed.expect_all_done();
    clean = contents(undisturbed.log_path());
  }
  run.settings = {"--set", "loop.duration_s=1"};
  start();
  run["controller"].signal(SIGKILL);
  run["controller"].wait();
  run.start("controller", {"--resume", run.log_path()});
  run.expect_all_done();
  EXPECT_TRUE(contents(run.log_path()) == clean);
  EXPECT_THAT(run["controller"].errors(), HasSubstr("resumed run 7 at tick"));
}

TEST_F(ByHand, RefusesToSucceedAControllerThatIsAlive) {
  run.settings = {"--set", "loop.duration_s=1"};
  start();
  Program second(
      "tachless-controller",
      {scenarios + "paper_rigid.yaml", "--set", "loop.duration_s=1", "--resume", run.log_path()},
      run.directory().path());
  EXPECT_EQ(second.wait(), 4);
  EXPECT_THAT(second.errors(), HasSubstr("there is already the controller"));
  run.expect_all_done();
}

TEST_F(ByHand, SaysSoWhenTheLogCannotBeResumedFromAndMarksTheEndInIt) {
  start_and_kill_controller();
  // Of the log only the beginning is left: what follows it is no longer known to anybody.
  const std::string beginning = run.directory() / "beginning";
  std::ofstream(beginning, std::ios::binary) << contents(run.log_path()).substr(0, 50'000);
  run.start("controller", {"--resume", beginning});
  EXPECT_EQ(run["controller"].wait(), 2);
  EXPECT_THAT(run["controller"].errors(),
              AllOf(HasSubstr("cannot resume run 7 from " + beginning), HasSubstr("ends before"),
                    HasSubstr("start a new run")));
  for (const char* role : {"plant", "reference", "logger"}) {
    EXPECT_EQ(run[role].wait(), 3) << run[role].errors();
    EXPECT_THAT(run[role].errors(), HasSubstr("cannot resume run 7")) << role;
  }
  logger::RunLog log = logger::RunLog::open(run.log_path());
  logger::TickRecord record;
  std::int64_t ticks = 0;
  while (log.next(record)) ++ticks;
  EXPECT_FALSE(log.damage().any());
  ASSERT_EQ(log.summary().faults.size(), 1U);
  // The controller's, or that of another that ended because of it and was heard first.
  const auto& fault = log.summary().faults[0];
  EXPECT_THAT(fault.text, HasSubstr("cannot resume run 7"));
  if (fault.role != loop::Role::controller) {
    EXPECT_THAT(fault.text, HasSubstr("because of the controller"));
  }
}

TEST_F(ByHand, ALogOfAnotherRunIsRefused) {
  FourPrograms other("paper_rigid.yaml", {"--run-id", "8"});
  other.start_all();
  other.expect_all_done();
  start_and_kill_controller();
  run.start("controller", {"--resume", other.log_path()});
  EXPECT_EQ(run["controller"].wait(), 2);
  EXPECT_THAT(run["controller"].errors(), HasSubstr("it is of run 8"));
  EXPECT_EQ(run["plant"].wait(), 3);
}

TEST(RestartOption, IsRefusedWhereTheRobotCannotWait) {
  Launched realtime("practical_rigid.yaml", {"--mode", "realtime", "--restart", "controller"});
  EXPECT_EQ(realtime.wait(), 2);
  EXPECT_THAT(realtime.errors(), HasSubstr("a realtime run does not wait"));

  Launched impatient("practical_rigid.yaml",
                     {"--set", "loop.give_up_s=1", "--restart", "controller"});
  EXPECT_EQ(impatient.wait(), 2);
  EXPECT_THAT(impatient.errors(), AllOf(HasSubstr("loop.give_up_s is 1 s"), HasSubstr("2 s")));

  const TemporaryDirectory directory;
  Program controller("tachless-controller",
                     {scenarios + "practical_rigid.yaml", "--set", "loop.mode=realtime", "--resume",
                      directory / "lcmlog"},
                     directory.path());
  EXPECT_EQ(controller.wait(), 2);
  EXPECT_THAT(controller.errors(), HasSubstr("--resume: a realtime run"));
}

}  // namespace

// `tachless run` with several robots on one bus: the logs of their own runs to the last bit, and
// one fate for all.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "base/json_text.h"
#include "logger/run_log.h"
#include "tests/support/packet_loss.h"
#include "tests/support/private_network.h"
#include "tests/support/process_facts.h"
#include "tests/support/program.h"
#include "tests/system/four_programs.h"

namespace tachless::several_robots_test {
namespace {

namespace fs = std::filesystem;
using messages::truth::DriveFault;
using system_test::scenarios;
using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::HasSubstr;
using ::testing::Not;

/// `tachless run` of scenarios of the tree that are given other robots' names.
class SeveralRobots : public ::testing::Test {
 protected:
  /// A copy of the scenario for a robot of this name.
  std::string scenario(const std::string& of, const std::string& robot) {
    std::string text = contents(scenarios + of);
    const auto replace = [&](const std::string& what, const std::string& by) {
      text.replace(text.find(what), what.size(), by);
    };
    replace("name: arm", "name: " + robot);
    replace("urdf: robots/", "urdf: " + scenarios + "robots/");
    const std::string path = directory_ / (robot + ".yaml");
    std::ofstream(path) << text;
    return path;
  }
  /// A rigid arm at 20 kHz and a flexible one at 1 kHz.
  std::vector<std::string> two_arms() {
    return {scenario("paper_rigid.yaml", "left"), scenario("practical_flexible.yaml", "right")};
  }

  Program start(std::vector<std::string> files, const std::vector<std::string>& more) {
    files.insert(files.begin(), "run");
    files.insert(files.end(), {"--run-id", "7", "--out", out().string()});
    files.insert(files.end(), more.begin(), more.end());
    return Program("tachless", files, directory_.path());
  }
  /// To its end. @return its exit code
  int run(const std::vector<std::string>& files, const std::vector<std::string>& more) {
    fs::remove_all(out());
    Program program = start(files, more);
    const int code = program.wait();
    errors_ = program.errors();
    output_ = program.output();
    return code;
  }
  /// The logs of the two arms when each is run alone.
  std::vector<std::string> logs_alone(const std::vector<std::string>& more) {
    std::vector<std::string> logs;
    for (const std::string& file : two_arms()) {
      EXPECT_EQ(run({file}, more), 0) << errors_;
      logs.push_back(contents(out() / "lcmlog"));
      EXPECT_FALSE(logs.back().empty());
    }
    return logs;
  }
  void expect_logs(const std::vector<std::string>& expected) const {
    EXPECT_TRUE(contents(out() / "left/lcmlog") == expected[0]);
    EXPECT_TRUE(contents(out() / "right/lcmlog") == expected[1]);
  }
  [[nodiscard]] nlohmann::json summary(const std::string& robot) const {
    return base::parse_json(contents(out() / robot / "summary.json"));
  }

  /// Waits until the robot's log has so many bytes.
  void wait_for_log(Program& program, const std::string& robot, std::uintmax_t bytes) const {
    std::error_code absent;
    for (;;) {
      const auto size = fs::file_size(out() / robot / "lcmlog", absent);
      if (!absent && size >= bytes) return;
      ASSERT_TRUE(program.running()) << program.errors();
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
  }
  /// Kills the robot's process of that program: it was given the robot's scenario.
  static void kill_process(const Program& launcher, const std::string& program,
                           const std::string& robot) {
    for (const pid_t pid : support::children_of(launcher.pid())) {
      const std::string command = contents(fs::path("/proc") / std::to_string(pid) / "cmdline");
      if (command.find(program) == std::string::npos ||
          command.find("/" + robot + ".yaml") == std::string::npos) {
        continue;
      }
      ASSERT_EQ(kill(pid, SIGKILL), 0);
      return;
    }
    FAIL() << program << " of " << robot << ": not found";
  }
  [[nodiscard]] fs::path out() const { return directory_ / "out"; }

  TemporaryDirectory directory_;
  std::string errors_;
  std::string output_;
};

TEST_F(SeveralRobots, LeaveTheLogsOfTheirOwnRunsAndATableEach) {
  const auto alone = logs_alone({"--duration", "0.2"});
  ASSERT_EQ(run(two_arms(), {"--duration", "0.2"}), 0) << errors_;
  expect_logs(alone);
  EXPECT_THAT(output_,
              AllOf(HasSubstr("\nleft: paper_rigid: "), HasSubstr("4000 ticks of 50 µs"),
                    HasSubstr("\nright: practical_flexible: "), HasSubstr("200 ticks of 1 ms"),
                    HasSubstr((out() / "right/tracking.svg").string()),
                    HasSubstr("\n  left    4000 "), HasSubstr("\n  right    200 ")));
  EXPECT_THAT(errors_, AllOf(HasSubstr("left: "), HasSubstr("right: ")));
  for (const char* robot : {"left", "right"}) {
    EXPECT_EQ(summary(robot)["log"]["gaps"], 0) << robot;
    EXPECT_EQ(summary(robot)["rejected"]["other_run"], 0) << robot;
    EXPECT_EQ(summary(robot)["run_id"], 7) << robot;
    EXPECT_TRUE(fs::exists(out() / robot / "report.html")) << robot;
  }
}

TEST_F(SeveralRobots, LeaveTheSameLogsWhenPacketsAreLostWithAKeyAndInOneProcess) {
  const auto alone = logs_alone({"--duration", "0.1"});
  const std::string key = directory_ / "key";
  std::ofstream(key) << std::string(64, '5');
  chmod(key.c_str(), 0600);
  // Every fifth packet: of the three by which `run` looks whether there is multicast two arrive.
  {
    const support::PacketLoss loss("numgen inc mod 5 0");
    EXPECT_EQ(run(two_arms(), {"--duration", "0.1", "--key-file", key, "--json"}), 0) << errors_;
  }
  expect_logs(alone);
  const auto told = base::parse_json(output_);
  EXPECT_GT(told.at("left").at("resends"), 0);
  EXPECT_EQ(told, (nlohmann::json{{"left", summary("left")}, {"right", summary("right")}}));
  fs::remove_all(out());
  EXPECT_EQ(run(two_arms(), {"--duration", "0.1", "--in-process"}), 0) << errors_;
  expect_logs(alone);
}

TEST_F(SeveralRobots, AreRefusedWhenTwoWouldUseOneChannel) {
  const std::string arm = scenario("practical_rigid.yaml", "arm");
  const std::string twin = scenario("practical_rigid.yaml", "Arm");
  const std::string link = scenario("practical_flexible.yaml", "arm_link");
  const std::string left = scenario("paper_rigid.yaml", "left");
  EXPECT_EQ(run({arm, left, twin}, {}), 2);
  EXPECT_THAT(errors_,
              AllOf(HasSubstr(arm + " and " + twin), HasSubstr("robot.name is arm and Arm"),
                    HasSubstr("write another robot.name into one of the files")));
  EXPECT_EQ(std::ranges::count(errors_, '\n'), 1) << errors_;
  EXPECT_EQ(run({arm, link}, {}), 2);
  EXPECT_THAT(errors_, HasSubstr("the channel ARM_LINK_STATE;"));
  EXPECT_EQ(run({left, arm}, {"--set", "robot.name=both"}), 2);
  EXPECT_FALSE(fs::exists(out()));
}

TEST_F(SeveralRobots, AreRefusedAllWhenTheLoopOfOneIsUnstable) {
  const auto files = two_arms();
  EXPECT_EQ(run(files, {"--set", "loop.command_delay=1"}), 2);
  EXPECT_THAT(errors_, AllOf(HasSubstr(files[0]), HasSubstr("unstable at 20 kHz")));
  EXPECT_FALSE(fs::exists(out()));
}

TEST_F(SeveralRobots, EndTogetherWhenAProcessOfOneIsKilledAndKeepTheirLogs) {
  Program program = start(two_arms(), {"--duration", "1000"});
  wait_for_log(program, "left", 500'000);
  wait_for_log(program, "right", 100'000);
  kill_process(program, "tachless-controller", "right");
  EXPECT_EQ(program.wait(), 3) << program.errors();
  EXPECT_THAT(program.errors(), AllOf(HasSubstr("right: controller was killed by signal 9"),
                                      HasSubstr("left: interrupted, because right failed"),
                                      Not(HasSubstr("left: controller"))));
  EXPECT_THAT(summary("right")["fault"].get<std::string>(), HasSubstr("controller was killed"));
  EXPECT_EQ(summary("left")["fault"], "interrupted, because right failed");
  for (const char* robot : {"left", "right"}) {
    logger::RunLog log = logger::RunLog::open(out() / robot / "lcmlog");
    logger::TickRecord record;
    while (log.next(record)) continue;
    EXPECT_FALSE(log.damage().any()) << robot;
    EXPECT_EQ(log.summary().gaps(), 0U) << robot;
    EXPECT_GT(log.summary().ticks, 100U) << robot;
    EXPECT_FALSE(log.summary().faults.empty()) << robot << ": why it ended is its last event";
  }
}

TEST_F(SeveralRobots, AreBroughtToRestOnTheWallClockWhenOneFails) {
  const std::vector<std::string> files = {scenario("practical_rigid.yaml", "left"),
                                          scenario("practical_rigid.yaml", "right")};
  // Whatever a busy machine makes them miss.
  Program program = start(files, {"--mode", "realtime", "--duration", "100", "--set",
                                  "loop.max_missed=1000", "--set", "loop.max_missed_share=1"});
  wait_for_log(program, "left", 100'000);
  wait_for_log(program, "right", 100'000);
  kill_process(program, "tachless-reference", "left");
  // 3 where a busy machine lets the launcher's order reach the plant before the missing reference
  // does; the plant comes to rest on either.
  EXPECT_THAT(program.wait(), AnyOf(5, 3)) << program.errors();
  EXPECT_THAT(program.errors(), HasSubstr("right: interrupted, because left failed"));
  for (const char* robot : {"left", "right"}) {
    logger::RunLog log = logger::RunLog::open(out() / robot / "lcmlog");
    logger::TickRecord record;
    while (log.next(record)) continue;
    ASSERT_TRUE(record.truth) << robot;
    EXPECT_EQ(record.truth->fault, DriveFault::protective_stop) << robot;
  }
}

TEST_F(SeveralRobots, EndAllOnCtrlC) {
  Program program = start(two_arms(), {"--duration", "1000", "--quiet"});
  wait_for_log(program, "left", 500'000);
  wait_for_log(program, "right", 100'000);
  program.signal(SIGINT);
  EXPECT_EQ(program.wait(), 130) << program.errors();
  for (const char* robot : {"left", "right"}) {
    EXPECT_EQ(summary(robot)["fault"], "interrupted") << robot;
    EXPECT_EQ(summary(robot)["log"]["gaps"], 0) << robot;
  }
}

TEST_F(SeveralRobots, InOneProcessAreNotBegunAfterOneThatFails) {
  EXPECT_EQ(run(two_arms(), {"--in-process", "--set", "plant.initial.position_rad=[1e155, 0]"}), 5);
  EXPECT_THAT(errors_, HasSubstr("right: not begun, because left did not end well"));
  EXPECT_FALSE(fs::exists(out() / "right/lcmlog"));
}

}  // namespace
}  // namespace tachless::several_robots_test

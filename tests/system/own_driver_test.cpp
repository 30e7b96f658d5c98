// examples/own_driver and examples/iiwa, built against the installation, in the plant's place, with
// the real reference, controller and logger.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "bus/udp_transport.h"
#include "logger/run_log.h"
#include "messages/truth/plant_truth.h"
#include "tests/support/private_network.h"
#include "tests/system/four_programs.h"

namespace tachless::own_driver_test {
namespace {

using namespace std::chrono_literals;
using messages::truth::DriveFault;
using system_test::FourPrograms;
using system_test::roles;
using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::HasSubstr;

class OwnDriver : public testing::Test {
 protected:
  void play(const std::vector<std::string>& settings) {
    run.plant = TACHLESS_BINARY_DIR "/installed/work/own_driver/build/own_driver";
    run.settings = settings;
    run.start_all();
  }
  void wait_until_it_moves() {
    while (run.log_size() < 200'000) {
      ASSERT_TRUE(run["plant"].running()) << run["plant"].errors();
      std::this_thread::sleep_for(1ms);
    }
  }
  std::vector<logger::TickRecord> ticks() {
    std::vector<logger::TickRecord> result;
    logger::RunLog log = logger::RunLog::open(run.log_path());
    logger::TickRecord record;
    while (log.next(record)) result.push_back(record);
    return result;
  }

  FourPrograms run{"../examples/own_driver/rig.yaml"};
};

TEST_F(OwnDriver, MovesTheRobotToWhereTheReferenceEnds) {
  // No busy machine shall end this run.
  play({"--set", "loop.max_missed=400", "--set", "loop.max_missed_share=1", "--set",
        "plant.following_error_rad=100"});
  run.expect_all_done();
  const auto record = ticks();
  ASSERT_EQ(record.size(), 2000U);
  const logger::TickRecord& last = record.back();
  ASSERT_TRUE(last.truth);
  // 1e-6 rad on a quiet machine; on a busy one it may just have missed some commands.
  EXPECT_NEAR(last.truth->q[0], 0.3, 0.02);
  EXPECT_NEAR(last.truth->q[1], -0.2, 0.02);
  for (const logger::TickRecord& each : record) {
    if (!each.truth) continue;
    EXPECT_LE(std::abs(each.truth->tau[0]), 200);
    EXPECT_LE(std::abs(each.truth->tau[1]), 40);
  }
}

TEST_F(OwnDriver, IsRunWithTheOthersByOneCommand) {
  const TemporaryDirectory directory;
  Program program("tachless",
                  {"run", TACHLESS_SOURCE_DIR "/examples/own_driver/rig.yaml", "--plant",
                   TACHLESS_BINARY_DIR "/installed/work/own_driver/build/own_driver", "--out",
                   directory / "out", "--set", "loop.max_missed=400", "--set",
                   "loop.max_missed_share=1", "--set", "plant.following_error_rad=100"},
                  directory.path());
  EXPECT_EQ(program.wait(), 0) << program.errors();
  EXPECT_THAT(program.errors(), HasSubstr("stable at"));
  logger::RunLog log = logger::RunLog::open(directory / "out" / "lcmlog");
  logger::TickRecord record;
  while (log.next(record)) continue;
  EXPECT_EQ(log.summary().ticks, 2000U);
}

TEST_F(OwnDriver, IsSentNothingInADryRun) {
  const TemporaryDirectory directory;
  Program program(
      "tachless",
      {"run", TACHLESS_SOURCE_DIR "/examples/own_driver/rig.yaml", "--plant",
       TACHLESS_BINARY_DIR "/installed/work/own_driver/build/own_driver", "--out",
       directory / "out", "--set", "loop.max_missed=400", "--set", "loop.max_missed_share=1",
       "--set", "plant.initial.position_rad=[0.1, 0]", "--dry-run"},
      directory.path());
  EXPECT_EQ(program.wait(), 0) << program.errors();
  EXPECT_THAT(program.output(), HasSubstr("not judged: a dry run"));
  logger::RunLog log = logger::RunLog::open(directory / "out" / "lcmlog");
  logger::TickRecord record;
  double most = 0;
  while (log.next(record)) {
    if (record.truth) {
      EXPECT_EQ(record.truth->q, Vector::Zero(2));
    }
    if (record.command) most = std::max(most, record.command->tau.cwiseAbs().maxCoeff());
  }
  EXPECT_GT(most, 1) << "the law commands, the rig is not where the reference is";
}

TEST_F(OwnDriver, StopsTheRobotWhenTheControllerDies) {
  play({"--set", "loop.duration_s=60", "--set", "loop.max_missed=400", "--set",
        "plant.following_error_rad=100"});
  wait_until_it_moves();
  run["controller"].signal(SIGKILL);
  for (const char* role : {"plant", "reference", "logger"}) {
    EXPECT_EQ(run[role].wait(), 5) << run[role].errors();
    // 401, or fewer when a busy machine makes the held torque's age come first.
    EXPECT_THAT(run[role].errors(),
                AllOf(HasSubstr("commands in a row did not come in time from the controller"),
                      AnyOf(HasSubstr("401 commands in a row"),
                            HasSubstr("longer than loop.max_missed (400) allows"))))
        << role;
  }
  messages::truth::PlantTruth last;
  for (const auto& each : ticks()) {
    if (each.truth) last = *each.truth;
  }
  EXPECT_EQ(last.fault, DriveFault::protective_stop);
  EXPECT_EQ(last.tau, Vector::Zero(2));
  EXPECT_LT(last.v.norm(), 0.01);
}

TEST_F(OwnDriver, SaysSoWhenItsDrivesHaveBrakedByThemselves) {
  play({"--set", "loop.duration_s=60", "--set", "loop.max_missed=1000", "--set",
        "plant.following_error_rad=100"});
  wait_until_it_moves();
  // For longer than the rig's watchdog, and not so long that the others give up.
  run["plant"].signal(SIGSTOP);
  std::this_thread::sleep_for(700ms);
  run["plant"].signal(SIGCONT);
  for (const char* role : roles) {
    EXPECT_EQ(run[role].wait(), 5) << run[role].errors();
    EXPECT_THAT(run[role].errors(), HasSubstr("had no torque for 500 ms")) << role;
  }
}

TEST_F(OwnDriver, IsNotStartedAwayFromWhereTheScenarioBegins) {
  play({"--set", "plant.initial.position_rad=[0.3, 0]"});
  EXPECT_EQ(run["plant"].wait(), 2);
  EXPECT_THAT(run["plant"].errors(),
              HasSubstr("plant.initial.position_rad: 0.3 for joint 1 (shoulder), which is at 0"));
  for (const char* role : {"reference", "controller", "logger"}) {
    EXPECT_EQ(run[role].wait(), 3) << run[role].errors();
    EXPECT_THAT(run[role].errors(), HasSubstr("move the robot")) << role;
  }
}

const std::string built = TACHLESS_BINARY_DIR "/installed/work/iiwa/build/";

/// The driver in the plant's place, and the rig.
struct IiwaRun : FourPrograms {
  IiwaRun() : FourPrograms("../examples/iiwa/iiwa.yaml") {
    plant = built + "iiwa_driver";
    // No busy machine shall end this run.
    settings = {"--set", "loop.max_missed=400",        "--set", "loop.max_missed_share=1",
                "--set", "plant.following_error_rad=1"};
  }
  Program rig{built + "iiwa_rig",
              {system_test::scenarios + "../examples/iiwa/iiwa.yaml"},
              directory().path()};
};

TEST(IiwaDriver, MovesAnArmThatAddsGravityAndIsTheClock) {
  // LCM's hashes of the fields that RobotLocomotion/drake lists.
  EXPECT_THAT(contents(built + "drake/lcmt_iiwa_status.hpp"), HasSubstr("0xf8b7dc0214255e51"));
  EXPECT_THAT(contents(built + "drake/lcmt_iiwa_command.hpp"), HasSubstr("0x6ee3e3b9c640a99a"));

  IiwaRun run;
  run.start_all();
  run.expect_all_done();
  logger::RunLog log = logger::RunLog::open(run.log_path());
  logger::TickRecord record;
  Vector q;
  while (log.next(record)) {
    if (record.truth) q = record.truth->q;
  }
  // Gravity twice would be half a radian beside it at joint 2: g of some 50 N m over a kp of 100.
  ASSERT_EQ(q.size(), 7);
  EXPECT_NEAR(q[1], 0.4, 0.02);
  EXPECT_NEAR(q[3], -1.1, 0.02);
}

TEST(IiwaDriver, EndsAsInterruptedWhateverItWaitsFor) {
  IiwaRun run;
  run.settings.insert(run.settings.end(), {"--set", "loop.duration_s=60"});
  run.start_all();
  wait_until("the arm moves", [&] { return run.log_size() > 200'000; });
  run["plant"].signal(SIGINT);  // nearly always while it waits for a status
  EXPECT_EQ(run["plant"].wait(), 130) << run["plant"].errors();
  for (const char* role : {"reference", "controller", "logger"}) {
    EXPECT_EQ(run[role].wait(), 3) << run[role].errors();
  }
}

TEST(IiwaDriver, PassesOverDamagedStatuses) {
  IiwaRun run;
  run.start_all();
  wait_until("the run begins", [&] { return run.log_size() > 0; });
  bus::UdpTransport transport;
  // A status's hash (turned by a bit, as LCM does) and time, then -1 joints, for which lcm-gen's
  // code cannot make room. Or three joints, of which nothing follows: fewer than the arm has.
  for (const unsigned char joints : {0xff, 0x03}) {
    std::vector<unsigned char> status = {0xf1, 0x6f, 0xb8, 0x04, 0x28, 0x4a, 0xbc, 0xa3};
    status.resize(16);
    status.resize(19, joints == 0xff ? 0xff : 0);
    status.push_back(joints);
    for (int i = 0; i < 500 && run["plant"].running(); ++i) {
      transport.publish("IIWA_STATUS", std::as_bytes(std::span(status)));
      std::this_thread::sleep_for(1ms);
    }
  }
  run.expect_all_done();
}

TEST(IiwaDriver, RampsAnArmFromWhereItStandsToTheStart) {
  const std::string folder = TACHLESS_SOURCE_DIR "/examples/iiwa/";
  const TemporaryDirectory directory;
  std::string elsewhere = contents(folder + "iiwa.yaml");
  const auto replace = [&](const std::string& from, const std::string& to) {
    ASSERT_NE(elsewhere.find(from), std::string::npos) << from;
    elsewhere.replace(elsewhere.find(from), from.size(), to);
  };
  replace("iiwa7.urdf", folder + "iiwa7.urdf");
  replace("position_rad: [0, 0.3, 0, -1.0, 0, 0.8, 0]",
          "position_rad: [0.05, 0.2, -0.1, -1.1, 0.05, 0.8, 0]");
  std::ofstream(directory / "elsewhere.yaml") << elsewhere;
  const Program rig(built + "iiwa_rig", {directory / "elsewhere.yaml"}, directory.path());
  const std::vector<std::string> command = {
      "run",          folder + "iiwa.yaml",      "--plant", built + "iiwa_driver",
      "--out",        directory / "out",         "--set",   "loop.max_missed=5000",
      "--set",        "loop.max_missed_share=1", "--set",   "plant.following_error_rad=1",
      "--any-outcome"};
  Program without("tachless", command, directory.path());
  EXPECT_EQ(without.wait(), 2);
  EXPECT_THAT(without.errors(), HasSubstr("(run --ramp)"));
  std::vector<std::string> with_ramp = command;
  with_ramp.push_back("--ramp");
  Program program("tachless", with_ramp, directory.path());
  EXPECT_EQ(program.wait(), 0) << program.errors();
  EXPECT_THAT(program.errors(), HasSubstr("ramp: joint "));
  logger::RunLog log = logger::RunLog::open(directory / "out-ramp" / "ramp" / "lcmlog");
  logger::TickRecord record;
  Vector before;
  double speed = 0;
  std::int64_t at = 0;
  while (log.next(record)) {
    if (!record.truth) continue;
    if (record.tick % 50 == 0) {
      if (before.size() > 0 && record.tick == at + 50) {
        speed = std::max(speed, (record.truth->q - before).cwiseAbs().maxCoeff() / 0.05);
      }
      before = record.truth->q;
      at = record.tick;
    }
  }
  // The slowest of the joints' limits is 1.71 rad/s; a tenth of it is the ramp's, missed commands
  // of a busy machine add.
  EXPECT_GT(speed, 0.05);
  EXPECT_LT(speed, 0.3);
  EXPECT_TRUE(std::filesystem::exists(directory.path() / "out" / "report.html"));
}

}  // namespace
}  // namespace tachless::own_driver_test

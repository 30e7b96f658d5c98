// Frames of drives with the MIT mode against bytes worked out by hand, and their driver against
// emulated drives on a bus of packets.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <optional>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "plant/drivers/mit_can/drives.h"
#include "plant/drivers/mit_can/emulated_drives.h"
#include "plant/drivers/mit_can/mit_driver.h"
#include "plant/drivers/mit_can/scan.h"
#include "tests/plant/peers.h"
#include "tests/support/temporary_directory.h"

namespace tachless::mit_can {
namespace {

using base::ExitCode;
using plant::Outcome;
using plant::Peers;
using testing::AllOf;
using testing::HasSubstr;
using Bytes = std::array<std::uint8_t, 8>;

const Drive dm8009{Family::damiao, 1, 17, ranges_of(Model::dm8009)};
const Drive rs04{Family::robstride, 3, 253, ranges_of(Model::rs04)};

TEST(MitFrames, OfADamiaoHaveTheBytesOfItsProtocol) {
  EXPECT_EQ(enable(dm8009).data, (Bytes{255, 255, 255, 255, 255, 255, 255, 0xFC}));
  EXPECT_EQ(disable(dm8009).data[7], 0xFD);
  EXPECT_EQ(clear_fault(dm8009).data[7], 0xFB);
  // Zeros are in the middle of the ranges that go both ways: 32768, 2048, 0, 0, 2048.
  const Frame zero = command(dm8009, {});
  EXPECT_EQ(zero.id, 1U);
  EXPECT_FALSE(zero.extended);
  EXPECT_EQ(zero.data, (Bytes{0x80, 0x00, 0x80, 0x00, 0x00, 0x00, 0x08, 0x00}));
  // All ends of the ranges: 65535, 4095, 4095, 4095, 4095.
  EXPECT_EQ(command(dm8009, {99, 99, 999, 99, 99}).data,
            (Bytes{255, 255, 255, 255, 255, 255, 255, 255}));
  EXPECT_EQ(ask(dm8009).id, 0x7FFU);
  EXPECT_EQ(ask(dm8009).data, (Bytes{1, 0, 0xCC, 0, 0, 0, 0, 0}));
  EXPECT_EQ(write_register(dm8009, Register::watchdog, watchdog_bits(0.1)).data,
            (Bytes{1, 0, 0x55, 9, 0xD0, 0x07, 0, 0}));
  EXPECT_EQ(read_register(dm8009, Register::tau_range).data, (Bytes{1, 0, 0x33, 23, 0, 0, 0, 0}));
}

TEST(MitFrames, OfARobStrideHaveTheBytesOfItsProtocol) {
  const Frame zero = command(rs04, {});
  EXPECT_TRUE(zero.extended);
  EXPECT_EQ(zero.id, 1U << 24U | 0x8000U << 8U | 3U);
  EXPECT_EQ(zero.data, (Bytes{0x80, 0, 0x80, 0, 0, 0, 0, 0}));
  EXPECT_EQ(command(rs04, {.tau = 120}).id, 1U << 24U | 0xFFFFU << 8U | 3U);
  EXPECT_EQ(enable(rs04).id, 3U << 24U | 253U << 8U | 3U);
  EXPECT_EQ(disable(rs04).id, 4U << 24U | 253U << 8U | 3U);
  EXPECT_EQ(clear_fault(rs04).data[0], 1);
  EXPECT_EQ(write_register(rs04, Register::watchdog, watchdog_bits(1)).data,
            (Bytes{0x28, 0x70, 0, 0, 0x20, 0x4E, 0, 0}));
}

TEST(MitFrames, GiveBackSetpointsAndAnswersWithinACount) {
  for (const Drive& drive : {dm8009, rs04}) {
    const Ranges& r = drive.ranges;
    const Setpoint set{1.234, -2.5, 0.3 * r.kp, 0.7 * r.kd, -0.4 * r.tau};
    const auto back = setpoint_in(drive, command(drive, set));
    ASSERT_TRUE(back);
    EXPECT_NEAR(back->q, set.q, r.q / 65535);
    EXPECT_NEAR(back->v, set.v, r.v / 4095);
    EXPECT_NEAR(back->kp, set.kp, r.kp / 4095);
    EXPECT_NEAR(back->kd, set.kd, r.kd / 4095);
    EXPECT_NEAR(back->tau, set.tau, r.tau / 4095);
    EXPECT_FALSE(setpoint_in(drive, enable(drive)));
    const Answer answer{-1.5, 3, 2, true, 0, 41};
    const auto told = answer_in(drive, answer_frame(drive, answer));
    ASSERT_TRUE(told);
    EXPECT_NEAR(told->q, answer.q, r.q / 65535);
    EXPECT_NEAR(told->v, answer.v, r.v / 4095);
    EXPECT_NEAR(told->tau, answer.tau, r.tau / 4095);
    EXPECT_TRUE(told->enabled);
    EXPECT_EQ(told->fault, 0);
    EXPECT_EQ(told->temperature, 41);
    Frame other = answer_frame(drive, answer);
    other.id ^= drive.family == Family::damiao ? 1U : 1U << 8U;
    EXPECT_FALSE(answer_in(drive, other));
  }
  const int hot = 0xC;
  EXPECT_EQ(answer_in(dm8009, answer_frame(dm8009, {.fault = hot}))->fault, hot);
  EXPECT_EQ(fault_text(Family::damiao, hot), "its coils are too hot");
  EXPECT_EQ(fault_text(Family::robstride, 0b100), "too hot");
}

/// A Damiao's torque has 12 bits and no zero, and so has its velocity, which kd turns into torque.
TEST(MitFrames, HaveNoMeanErrorOfTheirCounts) {
  constexpr int frames = 1000;
  for (const Drive& drive : {dm8009, rs04}) {
    for (const Setpoint& set : {Setpoint{.tau = 0}, Setpoint{.tau = 1.2345},
                                Setpoint{.q = 0.1234, .kp = 100, .kd = 5, .tau = -1}}) {
      double rest = 0, sum = 0;
      for (int k = 0; k < frames; ++k) {
        const Setpoint sent = *setpoint_in(drive, command(drive, set, rest));
        sum += sent.tau + sent.kp * (sent.q - set.q) + sent.kd * (sent.v - set.v);
      }
      const double count = 2 * drive.ranges.tau / 4095;
      EXPECT_NEAR(sum / frames, set.tau, count / frames);
    }
  }
}

TEST(MitFrames, KeepNoRestOfATorqueBeyondTheRange) {
  double rest = 0;
  for (int k = 0; k < 100; ++k) command(dm8009, {.tau = 80}, rest);
  EXPECT_NEAR(setpoint_in(dm8009, command(dm8009, {.tau = 20}, rest))->tau, 20, 0.03);
}

/// Two motors on an emulated bus.
class MitArm : public testing::Test {
 protected:
  scenario::Scenario scenario(std::vector<std::string> overrides = {},
                              const std::string& model = "dm10010") {
    const std::string driver = fmt::format(
        "plant.driver={{bus: 'unix:{}', watchdog_s: 5, motors: [{{model: {}, id: 1}}, {{model: {}, "
        "id: "
        "2}}]}}",
        (directory_.path() / "bus").string(), model, model);
    overrides.insert(overrides.begin(),
                     {driver, "plant.drive.torque_limit_Nm=100", "loop.max_missed=1000"});
    return plant::scenario(std::move(overrides));
  }

  /// Runs the plant with the driver against emulated drives.
  Outcome run(const scenario::Scenario& s, const Trouble& trouble) {
    Peers peers(s);
    peers.on_measurement = [&](std::int64_t k) { peers.command(k, Vector::Zero(2)); };
    Outcome outcome;
    try {
      EmulatedDrives drives(s, trouble);
      {
        const std::jthread serving([&](const std::stop_token& ends) { drives.serve(ends); });
        MitDriver driver(s);
        outcome = plant::run(s, peers, nullptr, &driver);
      }
      lost_ = drives.lost();
      end_ = drives.positions();
    } catch (const base::Failure& failure) {
      outcome.code = failure.code();
      outcome.fault = failure.what();
    }
    ticks_ = peers.ticks.size();
    truths_ = peers.truths.size();
    return outcome;
  }

  TemporaryDirectory directory_;
  std::size_t ticks_ = 0, truths_ = 0;
  std::int64_t lost_ = 0;
  Vector end_;  ///< positions of the arm after the run [rad]
};

TEST_F(MitArm, RunsToTheEndWithDrivesOfBothFamilies) {
  for (const char* model : {"dm10010", "rs04", "cybergear"}) {
    SCOPED_TRACE(model);
    const Outcome outcome = run(scenario({}, model), {});
    EXPECT_EQ(outcome.fault, "");
    EXPECT_EQ(ticks_, 30U);
    const auto& figures = outcome.statistics.plant().driver;
    ASSERT_EQ(figures.count("motor_2_hottest_C"), 1U);
    EXPECT_EQ(figures.at("motor_2_hottest_C"), 31);
  }
}

TEST_F(MitArm, CountsTicksWithoutAnAnswerAndGoesOn) {
  const scenario::Scenario s = scenario({"loop.duration_s=0.5"});
  const Outcome outcome = run(s, {.lost_share = 0.05});
  EXPECT_EQ(outcome.fault, "");
  EXPECT_GT(lost_, 0);
  const session::PlantStatistics& plant = outcome.statistics.plant();
  EXPECT_GT(plant.missed_readings, 0);
  EXPECT_EQ(ticks_, 500U);
  EXPECT_EQ(truths_, 500U - static_cast<std::size_t>(plant.missed_readings));
  EXPECT_GE(plant.driver.at("answers_missing"), static_cast<double>(plant.missed_readings));
}

/// The host's torques are zero: the drives alone bring the arm to the reference.
TEST_F(MitArm, SendsTheDrivesTheirSetPointsAndGains) {
  for (const char* model : {"dm10010", "rs04"}) {
    SCOPED_TRACE(model);
    const scenario::Scenario s =
        scenario({"loop.duration_s=0.5", "reference={hold: {position_rad: [0.3, -0.2]}}",
                  "plant.following_error_rad=10", "robot.joint_signs=[-1, 1]",
                  "robot.joint_offsets_rad=[0.1, 0]",
                  "plant.drive.loop={period_s: 1.0e-4, kp: [400, 100], kd: [5, 2]}"},
                 model);
    const Outcome outcome = run(s, {});
    EXPECT_EQ(outcome.fault, "");
    // M is about 9 kg m2: a quarter of a period lasts 0.24 s.
    EXPECT_GT(end_[0], 0.1);
    EXPECT_LT(end_[1], -0.05);
  }
}

/// The trials of commission do so. A brake with a hundredth of gravity would sag by radians.
TEST_F(MitArm, CarriesAllOfGravityInARunThatStatesAShareOfIt) {
  const scenario::Scenario arm = scenario({"robot.gravity_m_per_s2=9.81"});
  const scenario::Scenario trial = scenario({"robot.gravity_m_per_s2=0.0981"});
  EmulatedDrives drives(arm, {});
  const std::jthread serving([&](const std::stop_token& ends) { drives.serve(ends); });
  MitDriver driver(trial);
  const Vector before = driver.read().q;
  driver.start();
  driver.stop();
  for (int k = 0; k < 100; ++k) {
    driver.rest(0);
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  EXPECT_LT((driver.read().q - before).cwiseAbs().maxCoeff(), 0.01);
}

/// Drives that are disabled in motion would let the arm swing on: the emulated arm stays where it
/// is then, which is 10 to 15 mrad from where it was when it was stopped.
TEST_F(MitArm, IsDisabledOnceItRestsWhereItWasStopped) {
  const scenario::Scenario s =
      scenario::load_scenario(TACHLESS_SOURCE_DIR "/examples/mit_can/arm.yaml",
                              {"plant.driver.bus=unix:" + (directory_.path() / "bus").string(),
                               "plant.driver.watchdog_s=5", "loop.max_missed=1000"});
  EmulatedDrives drives(s, {});
  Vector stopped;
  {
    const std::jthread serving([&](const std::stop_token& ends) { drives.serve(ends); });
    MitDriver driver(s);
    driver.start();
    for (int k = 0; k < 15; ++k) {
      driver.hold(Vector::Zero(7), 0);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      stopped = driver.read().q;
    }
    driver.stop();
    for (int k = 0; k < 30; ++k) {
      driver.rest(0);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }
  EXPECT_FALSE(drives.any_enabled());
  EXPECT_LT((drives.positions() - stopped).cwiseAbs().maxCoeff(), 3e-3);
}

TEST_F(MitArm, RefusesGainsBeyondTheFrames) {
  const Outcome outcome =
      run(scenario({"plant.drive.loop={period_s: 1.0e-4, kp: 1, kd: [1, 5.5]}"}), {});
  EXPECT_EQ(outcome.code, ExitCode::bad_usage);
  EXPECT_THAT(outcome.fault, AllOf(HasSubstr("plant.drive.loop.kd: 5.5 for motor 2 of joint 2"),
                                   HasSubstr("its frames hold at most 5")));
}

TEST_F(MitArm, StopsWithTheNameOfASilentMotor) {
  const scenario::Scenario s = scenario({"loop.max_missed=300", "loop.duration_s=5"});
  const Outcome outcome = run(s, {.motor = 1, .after = 50, .silent = true});
  EXPECT_EQ(outcome.code, ExitCode::protective_stop);
  // A process that sleeps over the tick in which the driver would stop is stopped by the loop.
  if (outcome.fault.find("woke up to") != std::string::npos ||
      outcome.fault.find("made no progress") != std::string::npos) {
    GTEST_SKIP() << "this machine stood still: " << outcome.fault;
  }
  EXPECT_THAT(outcome.fault, HasSubstr("all motors but motor 2 of joint 2 (elbow) answered on "));
}

TEST_F(MitArm, StopsWithTheWordsOfAFault) {
  const Outcome outcome =
      run(scenario({"loop.duration_s=5"}), {.motor = 0, .after = 50, .fault = 0xC});
  EXPECT_EQ(outcome.code, ExitCode::protective_stop);
  EXPECT_THAT(outcome.fault, HasSubstr("has a fault: its coils are too hot"));
}

TEST_F(MitArm, SaysThatTheDrivesStopThemselvesWhenTheBusIsGone) {
  const Outcome outcome =
      run(scenario({"loop.duration_s=5"}), {.motor = 0, .after = 50, .bus_closes = true});
  EXPECT_EQ(outcome.code, ExitCode::protective_stop);
  EXPECT_THAT(outcome.fault, AllOf(HasSubstr("is gone"), HasSubstr("stop is not confirmed"),
                                   HasSubstr("the drives' watchdog stops them after 5 s")));
}

TEST_F(MitArm, IsRefusedBeforeItMoves) {
  const auto fault = [&](const scenario::Scenario& s, const Trouble& trouble) {
    const Outcome outcome = run(s, trouble);
    EXPECT_EQ(outcome.code, ExitCode::bad_usage);
    EXPECT_EQ(ticks_, 0U);
    return outcome.fault;
  };
  EXPECT_THAT(
      fault(scenario(), {.motor = 1, .torque_range_scale = 0.5}),
      AllOf(HasSubstr("plant.driver.motors: motor 2 of joint 2 (elbow) has the range 100 in "
                      "its register, not 200"),
            HasSubstr("set torque_max_Nm of it to 100")));
  EXPECT_THAT(fault(scenario({"plant.driver.watchdog_s=0.2"}), {}),
              HasSubstr("plant.driver.watchdog_s: 0.2 s; at least 1 s are needed"));
  EXPECT_THAT(fault(scenario({"plant.driver.speed=3"}), {}),
              HasSubstr("plant.driver.speed: unknown"));
  EXPECT_THAT(fault(scenario({"plant.driver.motors=[{model: dm4310, id: 1}]"}), {}),
              HasSubstr("plant.driver.motors: "));
  EXPECT_THAT(fault(scenario({"plant.driver.motors=[{model: robstride, id: 1}]"}), {}),
              HasSubstr("position_max_rad"));
  const scenario::Scenario s = scenario();
  try {
    MitDriver driver(s);
    FAIL() << "there is no bus";
  } catch (const base::Failure& failure) {
    EXPECT_THAT(failure.what(), HasSubstr("start the emulated bus first"));
  }
}

TEST_F(MitArm, IsFoundByAScan) {
  for (const char* model : {"dm10010", "rs04"}) {
    const scenario::Scenario s = scenario({}, model);
    EmulatedDrives drives(s);
    std::jthread serving([&](const std::stop_token& ends) { drives.serve(ends); });
    std::ostringstream found;
    const std::string bus = "unix:" + (directory_.path() / "bus").string();
    EXPECT_EQ(scan(bus, false, found, {2, 2, std::chrono::seconds(1)}), 2);
    const bool damiao = std::string_view(model) == "dm10010";
    EXPECT_THAT(found.str(),
                HasSubstr(damiao ? "damiao     id 2, answers on 18, disabled, ranges 12.5 rad, 20 "
                                   "rad/s, 200 N m, at 0.0002 rad"
                                 : "robstride  id 2, answers to host 253, at 0.0000 rad"));
  }
}

}  // namespace
}  // namespace tachless::mit_can

// A driver in the emulator's place, against peers that answer at once.
#include "plant/robot_driver.h"

#include <fmt/core.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <fstream>
#include <functional>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "base/file_text.h"
#include "base/logging.h"
#include "plant/guarded_robot.h"
#include "robot/dynamics.h"
#include "tests/plant/peers.h"
#include "tests/support/counting_new.h"
#include "tests/support/limited_elbow.h"
#include "tests/support/temporary_directory.h"

namespace tachless::plant {
namespace {

using namespace std::chrono_literals;
using base::ExitCode;
using messages::truth::DriveFault;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

/// A robot that stands where it is put and writes down what is done to it.
class Recording : public RobotDriver {
 public:
  [[nodiscard]] bool measures_velocity() const override { return velocity; }
  void start() override { calls += 's'; }
  ArmState read() override {
    calls += 'r';
    told_s = state.time_s;
    if (tells_time) {
      state.time_s = unit * base::seconds_of(base::Clock::now().time_since_epoch());
    }
    const int present = static_cast<int>(torques.size());
    if (present == at) fault();
    return state;
  }
  void hold(const Vector& tau, double until_s) override {
    calls += 'h';
    torques.push_back(tau);
    ends.push_back(until_s);
    on_hold();
  }
  std::function<void()> on_hold = [] {};  ///< after a torque
  void rest(double /*until_s*/) override { calls += '-'; }
  void stop() override {
    calls += 'x';
    if (stops_by_itself) throw StopsByItself("the link is gone; its watchdog brakes it");
    if (failing_stops-- > 0) throw std::runtime_error("the brake's line is open");
  }
  int failing_stops = 0;
  bool stops_by_itself = false;
  [[nodiscard]] std::vector<DriverFigure> figures() const override {
    return {{"torques", static_cast<double>(torques.size())}};
  }

  /// Number of torques after which `fault` is called.
  int at = -1;
  std::function<void()> fault = [] {};

  bool velocity = false;
  bool tells_time = false;
  double unit = 1;    ///< of its time [s]
  double told_s = 0;  ///< its time at the reading before
  ArmState state{Vector::Zero(2), Vector::Zero(2), {}, {}};
  std::string calls;
  std::vector<Vector> torques;
  std::vector<double> ends;
};

scenario::Scenario limited(std::vector<std::string> overrides = {}) {
  overrides.insert(overrides.begin(), {"plant.drive.torque_limit_Nm=[4, 1000]",
                                       // The emulator's keys change nothing.
                                       "plant.encoder.noise_std_rad=1", "plant.payload.mass_kg=3",
                                       // A busy machine misses fewer ticks in a row.
                                       "loop.max_missed=1000"});
  return scenario(std::move(overrides));
}

Outcome drive(const scenario::Scenario& scenario, Recording& robot) {
  Peers peers(scenario);
  return run(scenario, peers, nullptr, &robot);
}

std::string until_stop(const Recording& robot) {
  return robot.calls.substr(0, robot.calls.find('x') + 1);
}

void expect_stopped(const Recording& robot) {
  const std::size_t stop = robot.calls.find('x');
  ASSERT_NE(stop, std::string::npos);
  EXPECT_EQ(robot.calls.find('x', stop + 1), std::string::npos) << "stopped once";
  EXPECT_EQ(robot.calls.find('h', stop), std::string::npos) << "no torque after the stop";
}

TEST(RobotDriver, IsStartedReadAndDrivenTickByTickAndStoppedAtTheEnd) {
  const scenario::Scenario s = limited();
  Peers peers(s);
  Recording robot;
  robot.state.q << 0.004, -0.003;
  const Outcome outcome = run(s, peers, nullptr, &robot);
  ASSERT_EQ(outcome.fault, "");
  std::string expected = "rrs";  // the plant reads its position before it may move
  for (int k = 0; k < 30; ++k) expected += "rh";
  EXPECT_EQ(until_stop(robot), expected + 'x');
  const std::string after = robot.calls.substr(expected.size() + 1);
  EXPECT_THAT(after, HasSubstr("-")) << "it rests until the end";
  EXPECT_EQ(after.find_first_not_of('-'), std::string::npos) << after;
  ASSERT_EQ(robot.torques.size(), 30U);
  EXPECT_EQ(robot.torques[0], Vector::Zero(2));
  EXPECT_EQ(robot.torques[5], torque_of(4));
  EXPECT_EQ(robot.torques[20][0], 4) << "within the limit";
  EXPECT_EQ(robot.torques[20][1], torque_of(19)[1]);
  EXPECT_DOUBLE_EQ(robot.ends[29], 0.03);
  // TRUTH equals the driver's state, bit for bit.
  EXPECT_EQ(peers.truths[12].q, robot.state.q);
  EXPECT_TRUE(peers.truths[20].saturated[0]);
}

TEST(RobotDriver, IsSentTheTorqueInItsOwnSignsAndWithoutTheGravityThatItAdds) {
  const scenario::Scenario s = limited(
      {"robot.gravity_m_per_s2=9.81", "robot.compensates.gravity=true", "robot.joint_signs=[-1, 1]",
       "robot.joint_offsets_rad=[0.5, -0.25]", "plant.drive.torque_limit_Nm=1000"});
  Peers peers(s);
  Recording robot;
  robot.state.q << 0.504, 0.247;
  robot.state.v << 2, 3;
  ASSERT_EQ(run(s, peers, nullptr, &robot).fault, "");
  const messages::truth::PlantTruth& truth = peers.truths[5];
  EXPECT_EQ(truth.q, Vector(Eigen::Vector2d(0.5 - 0.504, 0.247 - 0.25)));
  EXPECT_EQ(truth.v, Vector(Eigen::Vector2d(-2, 3)));
  EXPECT_EQ(truth.tau, torque_of(4)) << "the log has the whole torque";
  const Vector sent = torque_of(4) - robot::gravity_torque(*s.model, truth.q);
  EXPECT_EQ(robot.torques[5], Vector(Eigen::Vector2d(-sent[0], sent[1])));
  // Before the first command, the arm's own torque holds it, except for the 4 mrad between its
  // position and the scenario's start.
  EXPECT_LT(robot.torques[0].norm(), 1);
}

TEST(RobotDriver, TellsTheLogTheTorquesThatTheArmAcceptedAndMeasured) {
  const scenario::Scenario s =
      limited({"robot.gravity_m_per_s2=9.81", "robot.compensates.gravity=true",
               "robot.joint_signs=[-1, 1]", "plant.drive.torque_limit_Nm=1000"});
  for (const bool accepts : {true, false}) {
    Peers peers(s);
    Recording robot;
    if (accepts) robot.state.accepted = Eigen::Vector2d(3, 4);
    robot.state.measured = Eigen::Vector2d(5, 6);
    ASSERT_EQ(run(s, peers, nullptr, &robot).fault, "");
    ASSERT_GE(peers.arm_torques.size(), 30U);
    const messages::truth::ArmTorque& told = peers.arm_torques[5];
    using messages::truth::Told;
    EXPECT_EQ(told.told, accepts ? Told::both : Told::measured);
    // The arm takes the torque without the gravity that it adds, and measures the whole torque.
    const Vector gravity = robot::gravity_torque(*s.model, peers.truths[5].q);
    EXPECT_EQ(told.accepted,
              accepts ? Vector(Eigen::Vector2d(-3, 4) + gravity) : Vector(Vector::Zero(2)));
    EXPECT_EQ(told.measured, Vector(Eigen::Vector2d(-5, 6)));
  }
  Peers peers(s);
  Recording silent;
  ASSERT_EQ(run(s, peers, nullptr, &silent).fault, "");
  EXPECT_TRUE(peers.arm_torques.empty());
}

TEST(RobotDriver, IsSentTheTorqueWithoutWhatTheArmAddsByItsOwnModel) {
  const TemporaryDirectory directory;
  std::string urdf =
      base::given_text(TACHLESS_SOURCE_DIR "/scenarios/robots/two_link.urdf", base::max_text_bytes);
  const std::size_t mass = urdf.find("<mass value=");
  ASSERT_NE(mass, std::string::npos);
  urdf.insert(urdf.find('"', mass) + 1, "1");  // of one link: 1 in front of the first digit
  std::ofstream(directory.path() / "own.urdf") << urdf;
  const scenario::Scenario s =
      limited({"robot.gravity_m_per_s2=9.81", "robot.base.rpy=[0, 0.5, 0]",
               "robot.compensates={gravity: true, coriolis: true, base_rpy: [0, 0.2, 0], urdf: " +
                   (directory.path() / "own.urdf").string() + "}",
               "plant.drive.torque_limit_Nm=1000"});
  Peers peers(s);
  Recording robot;
  robot.velocity = true;
  robot.state.q << 0.004, -0.003;
  robot.state.v << 2, 3;
  ASSERT_EQ(run(s, peers, nullptr, &robot).fault, "");
  robot::UrdfOptions options;
  options.base_rpy = {0, 0.2, 0};
  robot::Model own = robot::model_from_urdf(urdf, "own.urdf", options);
  own.gravity = {0, 0, -9.81};
  const Vector added = robot::gravity_torque(own, robot.state.q) +
                       robot::coriolis_product(own, robot.state.q, robot.state.v, robot.state.v);
  EXPECT_GT(robot::gravity_torque(own, robot.state.q).norm(), 1);
  EXPECT_GT(
      (robot::gravity_torque(*s.model, robot.state.q) - robot::gravity_torque(own, robot.state.q))
          .norm(),
      1);
  // The two models place gravity by different products of rotations.
  EXPECT_LT((robot.torques[5] - (torque_of(4) - added)).norm(), 1e-12 * added.norm());
}

TEST(RobotDriver, IsNotStartedWhereTheArmsOwnModelCannotBeRead) {
  const auto fault_of = [](const std::string& urdf) {
    Recording robot;
    const Outcome outcome =
        drive(limited({"robot.compensates={gravity: true, urdf: " + urdf + "}"}), robot);
    EXPECT_EQ(robot.calls, "");
    return outcome.fault;
  };
  EXPECT_THAT(fault_of("nowhere.urdf"),
              AllOf(HasSubstr("robot.compensates.urdf: "), HasSubstr("nowhere.urdf")));
  EXPECT_THAT(fault_of(TACHLESS_SOURCE_DIR "/scenarios/robots/iiwa7.urdf"),
              AllOf(HasSubstr("robot.compensates.urdf: its joints are "),
                    HasSubstr("allowed: those of robot.urdf")));
}

/// Robot that is the clock. Its ticks last `period_s`, and `unit` times that by its own time. A
/// robot that tells no time goes on at each answer.
class Ticking : public ClockDriver {
 public:
  [[nodiscard]] bool measures_velocity() const override { return false; }
  void start() override {}
  void stop() override { stopped = true; }
  ArmState exchange(const Vector& tau) override {
    if (tau.size() > 0) torques.push_back(tau);
    const double tick_s = tau.size() > 0 && torques.size() == 10 ? tenth_s : period_s;
    if (std::isfinite(state.time_s)) {
      next_ += base::nanoseconds_of(std::max(tick_s, 0.0));
      std::this_thread::sleep_until(next_);
    }
    state.time_s += unit * tick_s;
    return state;
  }

  double period_s = 1e-3, tenth_s = 2e-3;  // it misses one
  double unit = 1;
  ArmState state{Vector::Zero(2), Vector::Zero(2), {}, {}, {}, {}, 5};
  std::vector<Vector> torques;
  bool stopped = false;

 private:
  base::Clock::time_point next_ = base::Clock::now();
};

TEST(RobotDriver, ThatIsTheClockIsAnsweredOncePerTickAndCountsByItsOwnTime) {
  for (const int delay : {0, 1}) {
    const scenario::Scenario s =
        limited({fmt::format("loop.command_delay={}", delay), "plant.drive.torque_limit_Nm=1000"});
    Peers peers(s);
    Ticking robot;
    const Outcome outcome = run(s, peers, nullptr, &robot);
    ASSERT_EQ(outcome.fault, "");
    // The state of tick 10 is lost: nobody sees that tick, and nobody answers it.
    EXPECT_EQ(outcome.statistics.plant().missed_deadlines, 1);
    EXPECT_EQ(outcome.statistics.plant().missed_readings, 1);
    EXPECT_EQ(outcome.statistics.plant().missed_commands, 1);
    ASSERT_EQ(robot.torques.size(), 29U);
    EXPECT_EQ(robot.torques[0], delay == 0 ? torque_of(0) : Vector::Zero(2));
    EXPECT_EQ(robot.torques[10], torque_of(delay == 0 ? 11 : 9));
    EXPECT_EQ(robot.torques[20], torque_of(21 - delay));
    EXPECT_EQ(std::ranges::count(peers.ticks, 10), 0);
    EXPECT_EQ(peers.ticks.back(), 29);
    const auto& after = peers.truths.at(10);
    EXPECT_EQ(peers.truth_ticks.at(10), 11);
    EXPECT_EQ(after.fault, delay == 0 ? DriveFault::none : DriveFault::command_missed);
    EXPECT_EQ(outcome.statistics.plant().wake_up_jitter_us.count(), 29);
    EXPECT_TRUE(robot.stopped);
  }
}

TEST(RobotDriver, ThatIsTheClockMissesAsManyTicksAsItsTimeSays) {
  const scenario::Scenario s =
      limited({"plant.drive.torque_limit_Nm=1000", "loop.max_missed=300", "loop.duration_s=0.5"});
  for (const int lost : {15, 301}) {
    Peers peers(s);
    Ticking robot;
    robot.tenth_s = 1e-3 * (lost + 1);
    const Outcome outcome = run(s, peers, nullptr, &robot);
    const session::PlantStatistics& plant = outcome.statistics.plant();
    EXPECT_EQ(plant.missed_deadlines, lost);
    EXPECT_EQ(plant.longest_miss, lost);
    EXPECT_EQ(plant.longest_reading_miss, lost);
    EXPECT_EQ(plant.longest_command_miss, lost);
    EXPECT_TRUE(robot.stopped);
    if (lost == 15) {
      EXPECT_EQ(outcome.fault, "");
      EXPECT_EQ(peers.ticks.back(), 499);
      continue;
    }
    EXPECT_EQ(outcome.code, ExitCode::protective_stop);
    EXPECT_THAT(outcome.fault,
                HasSubstr("301 commands in a row are missing, since the driver had no reading of "
                          "the robot in the last 301 ticks, more than loop.max_missed (300)"));
  }
}

TEST(RobotDriver, ThatIsTheClockMayLoseTheStatesOfTheLastTicks) {
  const scenario::Scenario s = limited({"plant.drive.torque_limit_Nm=1000"});
  Peers peers(s);
  Ticking robot;
  robot.tenth_s = 40e-3;  // beyond the last of 30 ticks
  const Outcome outcome = run(s, peers, nullptr, &robot);
  EXPECT_EQ(outcome.fault, "");
  EXPECT_EQ(peers.ticks.back(), 9);
  EXPECT_TRUE(robot.stopped);
}

TEST(RobotDriver, WithoutAReadingHoldsTheLastTorqueForAMissedTick) {
  const scenario::Scenario s = limited({"plant.drive.torque_limit_Nm=1000"});
  Peers peers(s);
  Recording robot;
  robot.at = 10;
  robot.fault = [&] { robot.state.missing = true; };
  const int silent = 3;
  robot.on_hold = [&] {
    robot.state.missing = robot.state.missing && robot.torques.size() < 10 + silent;
  };
  const Outcome outcome = run(s, peers, nullptr, &robot);
  ASSERT_EQ(outcome.fault, "");
  const session::PlantStatistics& plant = outcome.statistics.plant();
  EXPECT_EQ(plant.missed_readings, silent);
  EXPECT_EQ(plant.longest_reading_miss, silent);
  EXPECT_EQ(plant.missed_commands, silent);
  ASSERT_EQ(robot.torques.size(), 30U);
  EXPECT_EQ(robot.torques[10], torque_of(9));
  EXPECT_EQ(robot.torques[12], torque_of(9));
  EXPECT_EQ(robot.torques[13], torque_of(9));
  EXPECT_EQ(robot.torques[14], torque_of(13));
  EXPECT_EQ(peers.ticks.size(), 30U) << "the reference goes on";
  EXPECT_EQ(peers.truths.size(), 27U);
  EXPECT_EQ(std::ranges::count(peers.truth_ticks, 11), 0) << "no old state is told as a new one";
}

/// In periods of 10 ms, a machine that stands still for 10 ms changes nothing.
TEST(RobotDriver, IsStoppedWhenItHasNoReadingForTooLong) {
  Recording before_the_start;
  before_the_start.state.missing = true;
  const scenario::Scenario s =
      limited({"loop.max_missed=5", "loop.period_s=0.01", "loop.duration_s=0.3"});
  Peers peers(s);
  Recording robot;
  robot.at = 10;
  robot.fault = [&] { robot.state.missing = true; };
  const Outcome outcome = run(s, peers, nullptr, &robot);
  EXPECT_EQ(outcome.code, ExitCode::protective_stop);
  EXPECT_THAT(outcome.fault, HasSubstr("6 commands in a row are missing, since the driver had no "
                                       "reading of the robot in the last 6 ticks"));
  expect_stopped(robot);
  Peers others(s);
  const Outcome refused = run(s, others, nullptr, &before_the_start);
  EXPECT_EQ(refused.code, ExitCode::bad_usage);
  EXPECT_THAT(refused.fault, HasSubstr("the driver had no reading of the robot 6 times in a row "
                                       "before the start"));
  EXPECT_EQ(before_the_start.calls, "rrrrrr");
}

TEST(RobotDriver, ThatIsTheClockComesToRestInItsOwnTime) {
  const scenario::Scenario s = limited({"loop.period_s=0.01", "loop.duration_s=10"});
  Peers peers(s);
  peers.on_measurement = [&](std::int64_t k) {
    if (k == 300) return peers.non_finite_command(k, controllers_address);
    peers.command(k, torque_of(k));
  };
  Ticking robot;
  robot.state.time_s = NAN;
  const auto begin = base::Clock::now();
  EXPECT_EQ(run(s, peers, nullptr, &robot).code, ExitCode::protective_stop);
  EXPECT_EQ(peers.truths.back().fault, DriveFault::protective_stop);
  // By the wall clock tick 301 is 3 s after the start, and this robot's ticks take microseconds.
  EXPECT_LT(base::Clock::now() - begin, 2s);
}

TEST(RobotDriver, IsHeldFromTheFirstTickOnUnlessTheScenarioSaysOtherwise) {
  const std::vector<std::string> hanging = {
      "robot.gravity_m_per_s2=9.81", "plant.drive.torque_limit_Nm=1000",
      "plant.initial.position_rad=[0.3, 0.2]", "plant.following_error_rad=100"};
  const auto first_torque = [](const scenario::Scenario& s) {
    Recording robot;
    robot.state.q << 0.3, 0.2;
    EXPECT_EQ(drive(s, robot).fault, "");
    return robot.torques.at(0);
  };
  const scenario::Scenario s = limited(hanging);
  const Vector q = s.plant.initial.position_rad;
  EXPECT_EQ(first_torque(s), robot::gravity_torque(*s.model, q));
  EXPECT_GT(first_torque(s).norm(), 1);
  std::vector<std::string> without = hanging;
  without.emplace_back("plant.initial.torque=zero");
  EXPECT_EQ(first_torque(limited(without)), Vector::Zero(2));
}

TEST(RobotDriver, InADryRunIsReadWhereverItStandsAndNeitherStartedNorSentAnything) {
  const scenario::Scenario s = limited({"plant.dry_run=true"});
  Peers peers(s);
  Recording robot;
  robot.state.q << 1, -2;
  const Outcome outcome = run(s, peers, nullptr, &robot);
  ASSERT_EQ(outcome.fault, "");
  EXPECT_FALSE(outcome.statistics.plant().robot_is_clock);
  EXPECT_EQ(robot.calls.find_first_not_of("r-"), std::string::npos) << robot.calls;
  EXPECT_EQ(std::ranges::count(robot.calls, 'r'), 32);
  // The log has the torques within the limits, although the robot got none.
  ASSERT_EQ(peers.truths.size(), 30U);
  EXPECT_EQ(peers.truths[5].tau, torque_of(4));
  EXPECT_EQ(peers.truths[20].tau[0], 4);

  Ticking clock;
  Peers others(s);
  EXPECT_EQ(run(s, others, nullptr, &clock).fault, "");
  EXPECT_TRUE(clock.torques.empty());
  EXPECT_FALSE(clock.stopped);
}

TEST(RobotDriver, IsSentZerosOnlyIfItAddsGravity) {
  const std::vector<std::string> zeros = {"plant.zero_torque=true",
                                          "robot.compensates={gravity: true}"};
  const scenario::Scenario s = limited(zeros);
  Peers peers(s);
  Recording robot;
  ASSERT_EQ(run(s, peers, nullptr, &robot).fault, "");
  ASSERT_EQ(robot.torques.size(), 30U);
  for (const Vector& torque : robot.torques) EXPECT_TRUE(torque.isZero(0)) << torque.transpose();
  EXPECT_FALSE(peers.truths[20].tau.isZero(0)) << "the log has the law's torque";
  Recording falling;
  try {
    GuardedRobot{limited({zeros[0]}), &falling};
    ADD_FAILURE();
  } catch (const base::Failure& failure) {
    EXPECT_THAT(failure.what(), AllOf(HasSubstr("plant.zero_torque: true, but the arm would fall"),
                                      HasSubstr("robot.compensates: {gravity: true}")));
  }
  EXPECT_THROW(GuardedRobot{s}, base::Failure);  // emulated
}

/// Torques are withheld in 2 of each 20 ticks, as in `commission`.
TEST(RobotDriver, IsSentNothingWhereTorquesAreWithheld) {
  const scenario::Scenario s = limited({"plant.withheld_ticks=2"});
  Peers peers(s);
  Recording robot;
  ASSERT_EQ(run(s, peers, nullptr, &robot).fault, "");
  std::string expected = "rrs";
  for (int tick = 0; tick < 30; ++tick) expected += tick == 18 || tick == 19 ? "r-" : "rh";
  EXPECT_EQ(until_stop(robot), expected + "x");
  EXPECT_THROW(GuardedRobot{s}, base::Failure);  // emulated
}

TEST(RobotDriver, IsStoppedWhereItsPositionsMoveFasterThanAllowed) {
  /// Robot whose elbow moves by `step` in each tick. An exchange takes 50 us, so that the run lasts
  /// longer than the window of the speed on any machine.
  class Moving final : public Ticking {
   public:
    ArmState exchange(const Vector& tau) override {
      const auto until = std::chrono::steady_clock::now() + 50us;
      while (std::chrono::steady_clock::now() < until) continue;
      if (tau.size() > 0) state.q[1] += step;
      return Ticking::exchange(tau);
    }
    double step = 0;
  };
  const auto fault = [](double step, bool tells_time) {
    const scenario::Scenario s =
        with_limited_elbow(limited({"plant.following_error_rad=1e9",
                                    fmt::format("loop.duration_s={}", tells_time ? 0.3 : 3)}),
                           R"(lower="-1e9" upper="1e9" effort="100" velocity="1.5")");
    Peers peers(s);
    Moving robot;
    robot.step = step;
    if (!tells_time) robot.state.time_s = NAN;
    return run(s, peers, nullptr, &robot).fault;
  };
  EXPECT_EQ(fault(1.4e-3, true), "");
  EXPECT_THAT(fault(1.6e-3, true),
              AllOf(HasSubstr("joint 2 (elbow) moves at 1."),
                    HasSubstr("faster than its limit of 1.5 rad/s"), Not(HasSubstr("on_limit"))));
  // The speed is by this process's time. A tick of 1 rad lasts less than 0.6 s on a busy machine.
  EXPECT_THAT(fault(1, false), HasSubstr("faster than its limit of 1.5 rad/s"));
  EXPECT_EQ(fault(0, false), "");
}

TEST(RobotDriver, ThatIsTheClockIsRefusedWhenItsTicksAreNotTheScenarios) {
  Ticking robot;
  robot.period_s = 2e-3;
  const scenario::Scenario s = limited();
  Peers peers(s);
  EXPECT_THAT(run(s, peers, nullptr, &robot).fault,
              HasSubstr("loop.period_s: 0.001 s, but the arm's ticks are 0.002 s apart"));
  EXPECT_TRUE(robot.torques.empty());
}

TEST(RobotDriver, IsStoppedWhenItsTimeGoesBackOrStandsStillWhileItMoves) {
  const scenario::Scenario s = limited({"plant.drive.torque_limit_Nm=1000"});
  for (const double step_s : {-1e-3, 0.0}) {
    Ticking clock;
    clock.tenth_s = step_s;
    Peers peers(s);
    const Outcome outcome = run(s, peers, nullptr, &clock);
    EXPECT_EQ(outcome.code, ExitCode::protective_stop);
    EXPECT_THAT(outcome.fault, HasSubstr("the robot's driver gave the time 5."));
    EXPECT_TRUE(outcome.statistics.plant().robot_is_clock);
    EXPECT_TRUE(clock.stopped);

    Recording robot;
    robot.at = 10;
    robot.tells_time = true;
    robot.fault = [&] {
      robot.state.q[0] += 1e-6;
      robot.state.time_s = robot.told_s + step_s;
    };
    const Outcome other = drive(s, robot);
    EXPECT_EQ(other.code, ExitCode::protective_stop);
    EXPECT_THAT(other.fault, HasSubstr("s before that: speeds cannot be watched"));
    expect_stopped(robot);
  }
}

TEST(RobotDriver, IsRefusedWhenItsTimeIsNotInSeconds) {
  const scenario::Scenario s = limited();
  for (const double unit : {1e3, 1e-9}) {
    Ticking clock;
    Recording robot;
    clock.unit = robot.unit = unit;
    robot.tells_time = true;
    Peers peers(s);
    const Outcome outcomes[] = {run(s, peers, nullptr, &clock), drive(s, robot)};
    for (const Outcome& outcome : outcomes) {
      EXPECT_EQ(outcome.code, ExitCode::bad_usage);
      EXPECT_THAT(outcome.fault, HasSubstr("times as fast as this computer's clock; give "
                                           "ArmState::time_s in seconds"));
    }
    EXPECT_TRUE(clock.torques.empty());
    EXPECT_THAT(robot.calls, Not(HasSubstr("s")));
  }
}

TEST(RobotDriver, IsStoppedWhenItsTimeBeginsToRunAtAnotherSpeed) {
  const scenario::Scenario s = limited({"plant.drive.torque_limit_Nm=1000", "loop.duration_s=10"});
  for (const double unit : {1e3, 0.0}) {
    Ticking clock;
    Peers peers(s);
    peers.on_measurement = [&](std::int64_t k) {
      if (k == 30) clock.unit = unit == 0 ? 1e-3 : unit;
      peers.command(k, torque_of(0));
    };
    const Outcome outcome = run(s, peers, nullptr, &clock);
    EXPECT_EQ(outcome.code, ExitCode::protective_stop);
    EXPECT_THAT(outcome.fault, HasSubstr("times as fast as this computer's clock: speeds cannot"));
    EXPECT_TRUE(clock.stopped);

    Recording robot;  // its time and its position stand still
    robot.tells_time = true;
    robot.at = 30;
    robot.fault = [&] {
      robot.at = -1;
      robot.unit = unit;
      if (unit == 0) robot.tells_time = false;
    };
    const Outcome other = drive(s, robot);
    EXPECT_EQ(other.code, ExitCode::protective_stop);
    EXPECT_THAT(other.fault, HasSubstr("times as fast as this computer's clock: speeds cannot"));
    expect_stopped(robot);
  }
}

TEST(RobotDriver, IsStoppedWhenItTellsItsTimeInSomeReadingsAlone) {
  const scenario::Scenario s = limited({"loop.duration_s=1"});
  Recording robot;
  robot.tells_time = true;
  robot.at = 10;
  robot.fault = [&] { robot.state.time_s = NAN; };
  const Outcome outcome = drive(s, robot);
  EXPECT_EQ(outcome.code, ExitCode::protective_stop);
  EXPECT_THAT(outcome.fault, HasSubstr("gave the time nan s at tick 10"));
  expect_stopped(robot);
}

class AFailingRobot : public testing::Test {
 protected:
  AFailingRobot() { robot_.at = 10; }
  Outcome run_it() { return run(s_, peers_, nullptr, &robot_); }

  const scenario::Scenario s_ = limited({"loop.duration_s=2"});
  Peers peers_{s_};
  Recording robot_;
};

TEST_F(AFailingRobot, IsStoppedAndSaysWhy) {
  robot_.fault = [] { throw base::Failure(ExitCode::protective_stop, "drive 2 is too hot"); };
  const Outcome outcome = run_it();
  EXPECT_EQ(outcome.code, ExitCode::protective_stop);
  EXPECT_THAT(outcome.fault, HasSubstr("drive 2 is too hot"));
  expect_stopped(robot_);
}

TEST_F(AFailingRobot, IsStoppedWhateverItThrows) {
  robot_.fault = [] { throw std::runtime_error("cable"); };
  const Outcome outcome = run_it();
  EXPECT_EQ(outcome.code, ExitCode::protective_stop);
  EXPECT_EQ(outcome.fault, "the driver threw: cable");
  expect_stopped(robot_);
  EXPECT_THAT(peers_.heard_plant.back().fault, HasSubstr("the driver threw: cable"));
}

TEST_F(AFailingRobot, IsStoppedWhenWhatItThrowsIsNoException) {
  robot_.fault = [] { throw 42; };
  const Outcome outcome = run_it();
  EXPECT_EQ(outcome.code, ExitCode::protective_stop);
  EXPECT_THAT(outcome.fault, HasSubstr("the driver threw an exception that is no std::exception"));
  expect_stopped(robot_);
}

TEST_F(AFailingRobot, IsStoppedWhenItReadsAnotherNumberOfJoints) {
  robot_.fault = [this] { robot_.state.q = Vector::Zero(7); };
  const Outcome outcome = run_it();
  EXPECT_EQ(outcome.code, ExitCode::protective_stop);
  EXPECT_THAT(outcome.fault, HasSubstr("the driver read 7 positions and 2 velocities of links, 0 "
                                       "and 0 of motors at tick 10; the scenario has 2 links"));
  expect_stopped(robot_);
}

TEST_F(AFailingRobot, IsStoppedWhenItTellsTheTorquesOfOtherJoints) {
  robot_.fault = [this] { robot_.state.measured = Vector::Zero(7); };
  const Outcome outcome = run_it();
  EXPECT_EQ(outcome.code, ExitCode::protective_stop);
  EXPECT_THAT(outcome.fault, HasSubstr("the driver read 7 measured torques at tick 10; the "
                                       "scenario has 2 joints: give ArmState::measured"));
  expect_stopped(robot_);
}

TEST_F(AFailingRobot, IsStoppedBeforeTheOthersAreInformedWhateverTheBusDoes) {
  const auto throws = [] { throw std::runtime_error("no route"); };
  const auto blocks = [] { std::this_thread::sleep_for(100ms); };
  for (const std::function<void()>& bus : {std::function<void()>(throws), {blocks}}) {
    Recording robot;
    robot.at = 10;
    robot.fault = [&robot] {
      robot.at = -1;
      throw base::Failure(ExitCode::protective_stop, "drive 2 is too hot");
    };
    Peers peers(s_);
    bool announced = false;
    peers.on_fault = [&] {
      if (!announced) {
        EXPECT_EQ(robot.calls.back(), 'x');
      }
      announced = true;
      bus();
    };
    const Outcome outcome = run(s_, peers, nullptr, &robot);
    EXPECT_TRUE(announced);
    EXPECT_EQ(outcome.code, ExitCode::protective_stop);
    EXPECT_THAT(outcome.fault, HasSubstr("drive 2 is too hot"));
    expect_stopped(robot);
  }
}

TEST_F(AFailingRobot, IsStoppedByASecondAttemptWhenTheFirstThrows) {
  for (const bool at_the_end : {false, true}) {
    const scenario::Scenario s = limited();
    Recording robot;
    robot.failing_stops = 1;
    robot.at = at_the_end ? -1 : 10;
    robot.fault = [] { throw base::Failure(ExitCode::protective_stop, "too hot"); };
    testing::internal::CaptureStderr();
    base::start_logging("tachless-plant", base::Verbosity::quiet);
    const Outcome outcome = drive(s, robot);
    EXPECT_THAT(testing::internal::GetCapturedStderr(),
                HasSubstr("the driver's stop failed, attempts: 1, the brake's line is open; the "
                          "next one succeeded"));
    EXPECT_EQ(outcome.fault, at_the_end ? "" : "too hot");
    EXPECT_THAT(robot.calls, HasSubstr("xx"));
    EXPECT_THAT(robot.calls, Not(HasSubstr("xxx")));
  }
}

TEST_F(AFailingRobot, IsReportedAsNotStoppedWhenItsStopKeepsFailing) {
  for (const bool at_the_end : {false, true}) {
    const scenario::Scenario s = limited();
    Recording robot;
    robot.failing_stops = 1000;
    robot.at = at_the_end ? -1 : 10;
    robot.fault = [] { throw base::Failure(ExitCode::peer_lost, "too hot"); };
    const Outcome outcome = drive(s, robot);
    EXPECT_EQ(outcome.code, at_the_end ? ExitCode::protective_stop : ExitCode::peer_lost);
    EXPECT_THAT(outcome.fault,
                AllOf(HasSubstr(at_the_end ? "" : "too hot; "),
                      HasSubstr("the driver's stop failed, attempts: "),
                      HasSubstr("the brake's line is open: use the emergency stop")));
  }
}

TEST_F(AFailingRobot, ThatStopsByItselfIsNotAskedAgainAndNeedsNoEmergencyStop) {
  for (const bool at_the_end : {false, true}) {
    const scenario::Scenario s = limited();
    Recording robot;
    robot.stops_by_itself = true;
    robot.at = at_the_end ? -1 : 10;
    robot.fault = [] { throw base::Failure(ExitCode::peer_lost, "too hot"); };
    const Outcome outcome = drive(s, robot);
    EXPECT_EQ(outcome.code, at_the_end ? ExitCode::protective_stop : ExitCode::peer_lost);
    EXPECT_THAT(outcome.fault,
                AllOf(HasSubstr(at_the_end ? "" : "too hot; "),
                      HasSubstr("the robot's stop is not confirmed, but the robot stops by itself: "
                                "the link is gone; its watchdog brakes it"),
                      Not(HasSubstr("emergency"))));
    EXPECT_EQ(std::ranges::count(robot.calls, 'x'), 1);
    EXPECT_EQ(outcome.statistics.plant().driver.at("torques"), at_the_end ? 30 : 10);
  }
}

TEST_F(AFailingRobot, IsStoppedWhenItReadsWhatIsNotFinite) {
  robot_.fault = [this] { robot_.state.q[1] = std::numeric_limits<double>::quiet_NaN(); };
  const Outcome outcome = run_it();
  EXPECT_EQ(outcome.code, ExitCode::protective_stop);
  EXPECT_THAT(outcome.fault, HasSubstr("not finite at tick 10"));
  expect_stopped(robot_);
}

TEST_F(AFailingRobot, IsStoppedWhenItsTorqueWasHeldForTooLong) {
  // The commands are there in time; the driver's process is not.
  robot_.fault = [] { std::this_thread::sleep_for(1100ms); };
  const Outcome outcome = run_it();
  EXPECT_EQ(outcome.code, ExitCode::protective_stop);
  EXPECT_THAT(outcome.fault, HasSubstr("torque has been held for "));
  EXPECT_THAT(outcome.fault, HasSubstr("loop.max_missed (1000)"));
  expect_stopped(robot_);
}

TEST_F(AFailingRobot, SaysThatCommandsWereMissingWhenItsTorqueWasHeldForTooLongBecauseOfThatToo) {
  peers_.on_measurement = [this](std::int64_t k) {
    if (k < 10) peers_.command(k, torque_of(k));
  };
  robot_.at = 20;
  robot_.fault = [] { std::this_thread::sleep_for(1001ms); };
  const Outcome outcome = run_it();
  EXPECT_EQ(outcome.code, ExitCode::protective_stop);
  EXPECT_THAT(outcome.fault, HasSubstr("torque has been held for "));
  EXPECT_THAT(outcome.fault,
              HasSubstr("commands in a row did not come in time from the controller"));
  EXPECT_THAT(outcome.fault,
              HasSubstr(", and this process, or the driver's read, made no progress"));
  expect_stopped(robot_);
}

TEST_F(AFailingRobot, ComesToRestWhileItIsStillMeasured) {
  robot_.fault = [this] {
    robot_.state.v << 0.5, 0.5;
    robot_.at = -1;
    throw base::Failure(ExitCode::protective_stop, "drive 2 is too hot");
  };
  EXPECT_EQ(run_it().code, ExitCode::protective_stop);
  expect_stopped(robot_);
  EXPECT_EQ(peers_.truths.back().fault, DriveFault::protective_stop);
  EXPECT_EQ(peers_.truths.back().tau, Vector::Zero(2));
  // The robot never comes to rest, so the plant reads it for the longest stop.
  EXPECT_EQ(std::ranges::count(robot_.calls.substr(robot_.calls.find('x')), 'r'), 500);
}

TEST(RobotDriver, IsStoppedWhenAJointLeavesItsRange) {
  // A real robot is not told to go on.
  const scenario::Scenario s = with_limited_elbow(
      limited({"plant.on_limit=warn"}), R"(lower="-1.5" upper="2" effort="100" velocity="10")");
  Recording robot;
  robot.at = 10;
  robot.fault = [&robot] { robot.state.q[1] = 3; };
  const Outcome outcome = drive(s, robot);
  EXPECT_EQ(outcome.code, ExitCode::protective_stop);
  EXPECT_THAT(outcome.fault,
              AllOf(HasSubstr("joint 2 (elbow) is at 3 rad at tick 10, outside of its range -1.5 "
                              "to 2 rad"),
                    Not(HasSubstr("plant.on_limit"))));
  expect_stopped(robot);
}

TEST(RobotDriver, IsDrivenWithoutAnAllocationOfTheLoop) {
  /// Driver that counts allocations from the beginning of `read` to that of `hold`.
  class Counting : public RobotDriver {
   public:
    [[nodiscard]] bool measures_velocity() const override { return false; }
    void start() override {}
    ArmState read() override {
      before_ = allocations;
      return state_;
    }
    void hold(const Vector& /*tau*/, double /*until_s*/) override {
      if (++ticks > 5) allocated += allocations - before_;
    }
    void stop() override {}

    int ticks = 0;
    std::size_t allocated = 0;

   private:
    ArmState state_{Vector::Zero(2), Vector::Zero(2), {}, {}};
    std::size_t before_ = 0;
  };
  const scenario::Scenario s = limited({"robot.compensates.gravity=true"});
  Peers peers(s);
  peers.on_measurement = [](std::int64_t) {};
  peers.truths.reserve(100);
  peers.truth_ticks.reserve(100);
  peers.ticks.reserve(100);
  peers.tick_utimes.reserve(100);
  Counting robot;
  ASSERT_EQ(run(s, peers, nullptr, &robot).fault, "");
  EXPECT_EQ(robot.ticks, 30);
  EXPECT_EQ(robot.allocated, 0U);
}

TEST(RobotDriver, IsNotStartedAwayFromWhereTheScenarioBegins) {
  Recording robot;
  robot.state.q[1] = 0.02;
  const Outcome outcome = drive(limited(), robot);
  EXPECT_EQ(outcome.code, ExitCode::bad_usage);
  EXPECT_THAT(outcome.fault,
              HasSubstr("plant.initial.position_rad: 0 for joint 2 (elbow), which is at "
                        "0.02; move the robot to within 0.01"));
  EXPECT_EQ(robot.calls, "rr") << "neither started nor stopped";
}

TEST(RobotDriver, IsRefusedInLockstepAndWithoutTorqueLimits) {
  Recording robot;
  EXPECT_THAT(drive(limited({"loop.mode=lockstep"}), robot).fault,
              HasSubstr("loop.mode: lockstep; a real robot does not wait"));
  const Outcome outcome = drive(scenario({}), robot);
  EXPECT_EQ(outcome.code, ExitCode::bad_usage);
  EXPECT_THAT(outcome.fault, HasSubstr("plant.drive.torque_limit_Nm: no limit"));
  EXPECT_EQ(robot.calls, "");
}

TEST(RobotDriver, ThatMeasuresNoVelocityIsRefusedByALawThatNeedsIt) {
  const scenario::Scenario s = limited({"loop.max_missed=20"});
  for (const bool measured : {false, true}) {
    Recording robot;
    robot.velocity = measured;
    Peers peers(s);
    peers.measurement = "STATE";
    const Outcome outcome = run(s, peers, nullptr, &robot);
    if (measured) {
      EXPECT_EQ(outcome.code, ExitCode::protective_stop) << "nobody commands here";
    } else {
      EXPECT_EQ(outcome.code, ExitCode::bad_usage);
      EXPECT_THAT(outcome.fault, HasSubstr("measures velocity, this robot does not"));
      EXPECT_EQ(robot.calls, "");
    }
  }
}

}  // namespace
}  // namespace tachless::plant

#include "plant/drive.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <vector>

#include "robot/model.h"

namespace tachless::plant {
namespace {

using messages::TorqueCommand;

TorqueCommand command(double first, double second) { return {Eigen::Vector2d(first, second)}; }

/// @param change that is possible from one tick to the next; empty: any
Drive drive(const Vector& limit, int delay, const Vector& change = {},
            const Vector& initial = Eigen::Vector2d(0, 0), int jitter = 0, std::uint64_t seed = 1) {
  DriveSpec spec;
  spec.torque_limit_Nm = limit;
  if (change.size() > 0) spec.torque_rate_limit_Nm_per_s = change;
  spec.command_age_jitter_ticks = jitter;
  spec.seed = seed;
  return Drive(spec, delay, 1, initial);
}
Drive drive(int delay) { return drive(Eigen::Vector2d(10, robot::Model::unlimited), delay); }

TEST(Drive, LimitsTheChangeOfTheTorqueThatIsSentWhereTheArmAddsOne) {
  const Vector ten = Vector::Constant(1, 10);
  Drive d = drive(10 * ten, 0, ten / 10, ten);
  d.set_added(ten);  // the arm holds itself: nothing is sent at first
  d.accept({ten});
  EXPECT_EQ(d.sent()[0], 0);
  d.end_tick();
  // Gravity and the command rise by 5 alike: nothing changes in what is sent.
  d.set_added(Vector::Constant(1, 15));
  d.accept({Vector::Constant(1, 15)});
  EXPECT_EQ(d.applied().tau[0], 15);
  EXPECT_FALSE(d.applied().saturated[0]);
  d.end_tick();
  // The command stays, gravity rises: what is sent would fall by 5, and falls by 1.
  d.set_added(Vector::Constant(1, 20));
  d.accept({Vector::Constant(1, 15)});
  EXPECT_EQ(d.sent()[0], -1);
  EXPECT_EQ(d.applied().tau[0], 19);
  EXPECT_TRUE(d.applied().saturated[0]);
  d.stop();
  d.set_added(ten);
  EXPECT_EQ(d.applied().tau[0], 0);
}

TEST(Drive, HoldsTheInitialTorqueUntilTheFirstCommandActs) {
  Drive held = drive(Eigen::Vector2d(10, 3), 2, {}, Eigen::Vector2d(4, -5));
  for (int tick = 0; tick < 2; ++tick) {
    held.accept({Eigen::Vector2d(1, 2)});
    EXPECT_EQ(held.applied().tau, Eigen::Vector2d(4, -3)) << "limited as any torque";
    held.end_tick();
  }
  held.accept({Eigen::Vector2d(7, 2)});
  EXPECT_EQ(held.applied().tau, Eigen::Vector2d(1, 2));
}

TEST(Drive, AppliesEachCommandAfterItsDelayAndHoldsTheLastWhenOneIsMissed) {
  for (const int delay : {0, 1, 2, 7, max_delay_ticks}) {
    Drive d = drive(delay);
    for (int k = 0; k < 60; ++k) {
      // Every fifth command is missed: the one before it is held.
      const auto source = [](int tick) { return tick % 5 == 4 ? tick - 1 : tick; };
      if (source(k) == k) {
        d.accept(command(0.1 * (k + 1), -k - 1));
      }
      const int tick = k < delay ? -1 : source(k - delay);
      EXPECT_EQ(d.applied().tau, command(0.1 * (tick + 1), -tick - 1).tau) << delay << ", " << k;
      EXPECT_EQ(d.applied().saturated[1], false);
      d.end_tick();
    }
  }
}

TEST(Drive, ChangesItsTorqueNoFasterThanItCanAndFlagsIt) {
  for (const int delay : {0, 1, 3}) {
    Drive d = drive(Eigen::Vector2d(10, robot::Model::unlimited), delay, Eigen::Vector2d(2, 1e9));
    for (int k = 0; k < 20; ++k) {
      d.accept(command(k < 10 ? 7 : -12, 5));
      const int since = k - delay;
      const double ramp =
          since < 10 ? std::min(2.0 * (since + 1), 7.0) : std::max(7 - 2.0 * (since - 9), -10.0);
      const double expected = since < 0 ? 0 : ramp;
      EXPECT_EQ(d.applied().tau, command(expected, since < 0 ? 0 : 5).tau) << k;
      const bool limited = since >= 0 && (since < 3 || since >= 10);
      EXPECT_EQ(d.applied().saturated[0], limited) << k;
      d.end_tick();
    }
    d.stop();  // power is off at once
    EXPECT_EQ(d.applied().tau, command(0, 0).tau);
    d.end_tick();
    EXPECT_EQ(d.applied().tau, command(0, 0).tau);
  }
}

TEST(Drive, TakesCommandsOfAnyAgeUpToTheJitterEachAsOftenBySeed) {
  constexpr int delay = 2, jitter = 3, ticks = 4000;
  const auto ages = [](std::uint64_t seed) {
    Drive d = drive(Eigen::Vector2d(1e9, 1e9), delay, {}, Eigen::Vector2d(0, 0), jitter, seed);
    std::vector<int> all;
    for (int k = 0; k < ticks; ++k) {
      const double before = d.applied().tau[0];
      d.accept(command(k, 0));
      if (k > 0) {
        EXPECT_EQ(d.applied().tau[0], before) << "the age is the tick's";
      }
      if (k >= delay + jitter) all.push_back(k - static_cast<int>(d.applied().tau[0]));
      d.end_tick();
    }
    return all;
  };
  const std::vector<int> found = ages(1);
  for (int age = delay; age <= delay + jitter; ++age) {
    // A quarter of 4000, with a standard deviation of 27.
    EXPECT_NEAR(std::ranges::count(found, age), ticks / 4, 110) << age;
  }
  EXPECT_EQ(*std::ranges::min_element(found), delay);
  EXPECT_EQ(*std::ranges::max_element(found), delay + jitter);
  EXPECT_EQ(found, ages(1));
  EXPECT_NE(found, ages(2));
}

TEST(Drive, LimitsEachJointAndFlagsIt) {
  Drive d = drive(0);
  d.accept(command(-12, 1e6));
  EXPECT_EQ(d.applied().tau, command(-10, 1e6).tau);
  EXPECT_TRUE(d.applied().saturated[0]);
  EXPECT_FALSE(d.applied().saturated[1]);
  d.end_tick();
  d.accept(command(10, 0));  // the limit itself is allowed
  EXPECT_FALSE(d.applied().saturated[0]);
}

TEST(Drive, RefusesANonFiniteCommandAndKeepsTheOldOne) {
  Drive d = drive(0);
  d.accept(command(1, 2));
  EXPECT_THROW(d.accept(command(std::numeric_limits<double>::quiet_NaN(), 0)), std::logic_error);
  EXPECT_THROW(d.accept(command(0, std::numeric_limits<double>::infinity())), std::logic_error);
  EXPECT_EQ(d.applied().tau, command(1, 2).tau);
}

TEST(Drive, GivesNoTorqueOnceStopped) {
  for (const int delay : {0, 1}) {
    Drive d = drive(delay);
    d.accept(command(12, 2));
    d.stop();
    EXPECT_EQ(d.applied().tau, command(0, 0).tau);
    EXPECT_FALSE(d.applied().saturated[0]);
    d.accept(command(3, 4));
    d.end_tick();
    EXPECT_EQ(d.applied().tau, command(0, 0).tau);
  }
}

TEST(Drive, RefusesWhatMakesNoSense) {
  EXPECT_THROW(drive(Eigen::Vector2d(1, 0), 0), std::logic_error);
  EXPECT_THROW(drive(Eigen::Vector2d(1, 1), 17), std::logic_error);
  EXPECT_THROW(drive(Eigen::Vector2d(1, 1), -1), std::logic_error);
  EXPECT_THROW(drive(Eigen::Vector2d(1, 1), 0, Eigen::Vector2d(1, 0)), std::logic_error);
  Drive d = drive(0);
  EXPECT_THROW(d.accept({Vector(Eigen::Vector3d(1, 2, 3))}), std::logic_error);
}

TEST(Drive, ThatSkipsTicksHoldsTheLastCommandAndChangesFromWhatWasSent) {
  DriveSpec spec;
  spec.torque_rate_limit_Nm_per_s = Vector::Constant(1, 1000);
  Drive limited(spec, 1, 1e-3, Vector::Zero(1));
  limited.accept({Vector::Constant(1, 5)});
  EXPECT_EQ(limited.sent()[0], 0);
  limited.end_tick();
  limited.skip(15);  // nothing was sent
  EXPECT_EQ(limited.sent()[0], 1) << "one tick's change from what was sent last";
  limited.end_tick();
  EXPECT_EQ(limited.sent()[0], 2);
  Drive late({}, 3, 1e-3, Vector::Zero(1));
  late.accept({Vector::Constant(1, 5)});
  late.end_tick();
  late.skip(1);
  EXPECT_EQ(late.sent()[0], 0) << "it acts three ticks later";
  late.skip(1);
  EXPECT_EQ(late.sent()[0], 5);
}

}  // namespace
}  // namespace tachless::plant

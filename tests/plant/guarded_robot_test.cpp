// The emulator against the URDF's limits, without a bus and without a clock.
#include "plant/guarded_robot.h"

#include <fmt/core.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "base/logging.h"
#include "tests/support/limited_elbow.h"

namespace tachless::plant {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr const char* narrow = R"(lower="-0.05" upper="2" effort="100" velocity="10")";
constexpr const char* slow = R"(lower="-3" upper="3" effort="100" velocity="1.5")";

/// The elbow moves at some -2 rad/s, and nothing acts on it.
scenario::Scenario moving(const std::string& name, const std::string& limit,
                          std::vector<std::string> overrides = {}) {
  overrides.insert(overrides.end(),
                   {"robot.gravity_m_per_s2=0", "loop.period_s=0.001", "loop.duration_s=0.1",
                    "plant.initial.velocity_rad_per_s=[1.5, -2]"});
  return with_limited_elbow(
      scenario::load_scenario(fmt::format("{}/scenarios/{}.yaml", TACHLESS_SOURCE_DIR, name),
                              overrides),
      limit);
}

void coast(GuardedRobot& robot, std::int64_t tick) {
  robot.accept({Vector::Zero(2)});
  robot.advance(tick);
  robot.end_tick();
}

/// Why `robot` stops, and the tick at which it does; "" when it does not in 100 ticks.
struct End {
  std::string fault;
  std::int64_t tick = 0;
};
End run(GuardedRobot& robot) {
  robot.start();
  for (std::int64_t k = 0; k < 100; ++k) {
    try {
      robot.read(k);
    } catch (const base::Failure& failure) {
      EXPECT_EQ(failure.code(), base::ExitCode::protective_stop);
      return {failure.what(), k};
    }
    coast(robot, k);
  }
  return {};
}

TEST(GuardedRobot, StopsAnEmulatedJointThatLeavesItsRangeAtTheFirstTickOutside) {
  const scenario::Scenario s = moving("practical_rigid", narrow);
  GuardedRobot robot(s);
  const End end = run(robot);
  EXPECT_THAT(end.fault,
              AllOf(HasSubstr(fmt::format("joint 2 (elbow) is at {:.6g} rad at tick {}, outside of "
                                          "its range -0.05 to 2 rad in robots/two_link.urdf",
                                          robot.state().q[1], end.tick)),
                    HasSubstr("plant.on_limit: warn")));
  // -2 rad/s but for what the shoulder adds, so some 25 ticks; not a whole tick's way too late.
  EXPECT_LT(robot.state().q[1], -0.05);
  EXPECT_GT(robot.state().q[1], -0.05 + 1.5e-3 * robot.state().v[1]);
}

TEST(GuardedRobot, StopsAnEmulatedJointThatIsTooFast) {
  const scenario::Scenario s = moving("practical_rigid", slow);
  GuardedRobot robot(s);
  const End end = run(robot);
  EXPECT_EQ(end.tick, 0);
  EXPECT_THAT(end.fault, HasSubstr("joint 2 (elbow) moves at -2 rad/s at tick 0, faster than its "
                                   "limit of 1.5 rad/s in robots/two_link.urdf"));
}

TEST(GuardedRobot, StopsAJointThatIsTooFastForTheEndOfItsRange) {
  // The elbow moves from 0 at some -2 rad/s. At a distance d from the end, sqrt(2 8 d) - 0.4 is
  // allowed: 2 rad/s at d = 0.36.
  const scenario::Scenario s = moving(
      "practical_rigid", R"(lower="-0.5" upper="3" velocity="10"/><position_based_velocity_limits )"
                         R"(deceleration_limit="8" velocity_offset="0.4")");
  GuardedRobot robot(s);
  const End end = run(robot);
  EXPECT_THAT(end.fault, AllOf(HasSubstr("joint 2 (elbow) moves at -"),
                               HasSubstr("near the end of its range, of "),
                               HasSubstr("plant.on_limit: warn")));
  const double q = robot.state().q[1], v = robot.state().v[1];
  const auto allowed = [](double at) { return std::sqrt(16 * (at + 0.5)) - 0.4; };
  EXPECT_LT(-v, allowed(q)) << "an arm that watches its speed itself has not stopped yet";
  EXPECT_GT(-v, allowed(q + MotionGuard::lead_s * v)) << "it would have within 20 ms";
}

TEST(GuardedRobot, LetsAJointMoveAtItsLimitButForRounding) {
  // The elbow starts at -2 rad/s, beyond its limit by 1e-12.
  const char* almost = R"(lower="-3" upper="3" effort="100" velocity="1.999999999999")";
  const scenario::Scenario s = moving("practical_rigid", almost);
  GuardedRobot robot(s);
  robot.start();
  EXPECT_NO_THROW(robot.read(0));
}

TEST(GuardedRobot, LetsAJointGoThatHasNoLimit) {
  // A velocity of 0 is none, and a continuous joint has no range.
  const scenario::Scenario s =
      moving("practical_rigid", R"(lower="-3" upper="3" effort="0" velocity="0")");
  GuardedRobot robot(s);
  EXPECT_EQ(run(robot).fault, "");
}

TEST(GuardedRobot, WarnsOncePerJointAndMarksEachTickWhereTheScenarioSaysSo) {
  const scenario::Scenario s = moving("practical_rigid", narrow, {"plant.on_limit=warn"});
  GuardedRobot robot(s);
  int outside = 0, marked = 0;
  ::testing::internal::CaptureStderr();
  base::start_logging("tachless-plant", base::Verbosity::quiet);
  robot.start();
  for (std::int64_t k = 0; k < 100; ++k) {
    robot.read(k);
    outside += robot.state().q[1] < -0.05 ? 1 : 0;
    marked += robot.beyond_limit()[1] ? 1 : 0;
    EXPECT_FALSE(robot.beyond_limit()[0]);
    coast(robot, k);
  }
  const std::string said = ::testing::internal::GetCapturedStderr();
  EXPECT_GT(outside, 50);
  EXPECT_EQ(marked, outside);
  const std::size_t first = said.find("outside of its range -0.05 to 2 rad");
  ASSERT_NE(first, std::string::npos) << said;
  EXPECT_THAT(said.substr(first + 1), Not(HasSubstr("outside of its range")));
}

TEST(GuardedRobot, WatchesTheLinksOfFlexibleJointsNotTheirMotors) {
  // The motor begins outside of the link's range and faster than the link may be.
  const std::vector<std::string> motor = {"plant.initial.motor_position_rad=[0, -0.06]",
                                          "plant.initial.motor_velocity_rad_per_s=[1.5, -20]"};
  const scenario::Scenario s = moving("practical_flexible", narrow, motor);
  GuardedRobot robot(s);
  robot.start();
  EXPECT_NO_THROW(robot.read(0));
  EXPECT_LT(robot.state().theta[1], -0.05);
  const End end = run(robot);
  EXPECT_THAT(end.fault, HasSubstr("joint 2 (elbow) "));
  EXPECT_GT(end.tick, 0);
}

TEST(GuardedRobot, IsReadOnBeyondItsLimitsOnceItIsStopped) {
  const scenario::Scenario s = moving("practical_rigid", narrow);
  GuardedRobot robot(s);
  const End end = run(robot);
  ASSERT_NE(end.fault, "");
  robot.stop();
  for (std::int64_t k = end.tick; k < end.tick + 500; ++k) {
    robot.advance(k);
    ASSERT_NO_THROW(robot.read(k + 1));
  }
  // Five time constants of the brake; the coupling of the joints allows some more.
  EXPECT_LT(robot.state().v.norm(), 0.05 * 2.5);
}

TEST(GuardedRobot, IsSensedAsItWasSomeTicksAgo) {
  for (const int latency : {0, 1, 5, 16}) {
    const scenario::Scenario scenario =
        moving("paper_rigid", R"(lower="-3" upper="3" effort="100" velocity="10")",
               {fmt::format("plant.encoder.latency_ticks={}", latency)});
    GuardedRobot robot(scenario);
    robot.feed("POSITION");
    robot.start();
    std::vector<Vector> q;
    for (std::int64_t k = 0; k < 40; ++k) {
      q.push_back(robot.read(k).q);
      EXPECT_EQ(std::get<messages::PositionMeasurement>(robot.measure(k)).q,
                q.at(static_cast<std::size_t>(std::max<std::int64_t>(k - latency, 0))));
      coast(robot, k);
    }
    EXPECT_NE(q.front(), q.back());
  }
}

TEST(GuardedRobot, FeedsALawWithNothingThatIsNoMeasurement) {
  const scenario::Scenario scenario = moving("paper_rigid", slow);
  GuardedRobot robot(scenario);
  try {
    robot.feed("COMMAND");
    FAIL();
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::protocol_violated);
    EXPECT_THAT(failure.what(), HasSubstr("'COMMAND'"));
  }
}

}  // namespace
}  // namespace tachless::plant

// The driver of Universal Robots' arms with a stand-in for the maker's library, which emulates the
// arm in this process and in its own time.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "commission/commission.h"
#include "commission/emulated_arm.h"
#include "controller/registry.h"
#include "plant/drivers/ur/ur_driver.h"
#include "plant/guarded_robot.h"
#include "reference/make_trajectory.h"
#include "tests/plant/failure_of.h"

namespace tachless::ur {
namespace {

using base::ExitCode;
using base::Failure;
using plant::testing::failure_of;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using urcl::EmulatedArm;

scenario::Scenario arm_of(const std::vector<std::string>& settings = {}) {
  return scenario::load_scenario(TACHLESS_SOURCE_DIR "/examples/ur/arm.yaml", settings);
}

/// Runs the scenario's law by the driver, and returns the root mean square of each joint's error
/// [rad].
Vector run(const scenario::Scenario& s) {
  UrDriver driver(s);
  const controller::ScenarioLaw law = controller::scenario_law(s);
  const reference::Trajectory trajectory = reference::make_trajectory(s);
  plant::GuardedRobot robot(s, &driver);
  robot.feed(law->measurement());
  robot.start();
  Vector squares = Vector::Zero(6);
  for (std::int64_t k = 0; k < s.loop.num_ticks; ++k) {
    robot.read(k);
    EXPECT_EQ(robot.tick(), k) << "no tick is lost";
    const auto reference = trajectory.at(static_cast<double>(k) * s.loop.period_s);
    const auto outcome = law->step(k, robot.measure(k), reference);
    squares += (robot.state().q - reference.q_ref).cwiseAbs2();
    robot.accept(outcome.command);
    robot.advance(k);
    robot.end_tick();
  }
  robot.stop();
  robot.require_stopped();
  return (squares / static_cast<double>(s.loop.num_ticks)).cwiseSqrt();
}

TEST(UrDriver, TracksOnTheEmulatedArmWithoutTheArmsOwnFriction) {
  const auto s = arm_of();
  EmulatedArm arm(s);
  // Measured 8.5e-6 rad, and 1e-4 rad without the arm's step in the lead of the feed-forward.
  EXPECT_LT(run(s).maxCoeff(), 2e-5);
  EXPECT_EQ(arm.viscous_scale, urcl::vector6d_t{});
  EXPECT_EQ(arm.coulomb_scale, urcl::vector6d_t{});
  EXPECT_EQ(arm.payload_kg, -1) << "that of the installation";
  EXPECT_EQ(arm.stops, 1);
  EXPECT_FALSE(arm.program_runs);
}

/// The scenario states that the arm adds nothing and acts without delay.
TEST(UrDriver, IsCommissionedThroughTheDriver) {
  const auto claimed =
      arm_of({"robot.compensates={}", "plant.encoder.latency_ticks=0", "plant.mechanics=native"});
  EmulatedArm arm(arm_of());
  const commission::Commissioned found = commission::commission(
      claimed,
      [](const scenario::Scenario& trial, const std::vector<std::string>& changes) {
        UrDriver driver(trial);
        return commission::trials_on(driver)(trial, changes);
      },
      [](std::string_view) {});
  EXPECT_THAT(found.misfits, ElementsAre(HasSubstr("write robot.compensates: {gravity: true"),
                                         HasSubstr("write plant.encoder.latency_ticks: 1")));
  EXPECT_TRUE(found.mendable);
  EXPECT_EQ(found.adds_gravity, true);
  EXPECT_EQ(found.delay, 1) << "the arm takes a torque at its next step";
  EXPECT_TRUE(found.arm_is_clock);
  EXPECT_EQ(found.unsent, commission::Unsent::held);
  for (const commission::Commissioned::Joint& joint : found.joints) {
    EXPECT_EQ(joint.turns, false) << joint.name;
    // Measured 1.000; the driver sends torques in whole micronewton metres.
    EXPECT_NEAR(joint.scale.value_or(0), 1, 0.02) << joint.name;
  }
}

TEST(UrDriver, TellsTheArmItsPayload) {
  const auto s = arm_of({"plant.driver.payload.mass_kg=1.5"});
  EmulatedArm arm(s);
  UrDriver driver(s);
  driver.start();
  EXPECT_EQ(arm.payload_kg, 1.5F);
}

TEST(UrDriver, RefusesWithTheRemedy) {
  const auto s = arm_of({"plant.driver.start_wait_s=0.01"});
  EmulatedArm arm(s);
  const auto problem = [](const scenario::Scenario& of) {
    const auto failure = failure_of([&] { UrDriver(of).start(); });
    if (!failure) return std::string("none");
    EXPECT_EQ(failure->code(), ExitCode::bad_usage);
    return std::string(failure->what());
  };
  EXPECT_EQ(problem(s), "none");
  arm.version = "5.24.9";
  EXPECT_THAT(problem(s), HasSubstr("its PolyScope 5.24.9 does not set the shares of friction"));
  arm.version = "10.11.9";
  EXPECT_THAT(problem(s), HasSubstr("update it to 10.12.1 or later"));
  arm.version = "10.12.1";
  EXPECT_EQ(problem(s), "none");
  arm.takes_friction_scales = false;
  EXPECT_THAT(problem(s), HasSubstr("did not take the friction scales"));
  arm.silent_from = 0;
  EXPECT_THAT(problem(s), HasSubstr("it sends no states"));
  arm.program_starts = false;
  arm.program_runs = false;
  EXPECT_THAT(problem(s), AllOf(HasSubstr("did not start within 0.01 s"),
                                HasSubstr("set the arm to remote control")));
  arm.is_there = false;
  EXPECT_THAT(problem(s), HasSubstr("(plant.driver.address): Failed to connect to 192.168.56.101"));
  EXPECT_THAT(problem(arm_of({"plant.driver.payload.center_m=[1]"})),
              HasSubstr("center_m: 1 numbers; allowed: 3"));
  EXPECT_THAT(problem(scenario::load_scenario(TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml",
                                              {"plant.driver={address: a, script: b}"})),
              HasSubstr("2 joints; an arm of Universal Robots has 6"));
}

/// Holds the arm by zero torques until the driver fails.
std::optional<Failure> failure_in_motion(UrDriver& driver) {
  driver.start();
  return failure_of([&] {
    for (int k = 0; k < 100; ++k) driver.hold(Vector::Zero(6), 0);
  });
}

TEST(UrDriver, NamesTheSafetyStop) {
  const auto s = arm_of();
  EmulatedArm arm(s);
  arm.protective_stop_at = 20;
  UrDriver driver(s);
  const auto failure = failure_in_motion(driver);
  ASSERT_TRUE(failure);
  EXPECT_EQ(failure->code(), ExitCode::protective_stop);
  EXPECT_THAT(failure->what(), HasSubstr("a protective stop: see the pendant"));
  driver.stop();
  EXPECT_EQ(arm.stops, 0) << "it has stopped";
}

TEST(UrDriver, NamesTheEndOfTheArmsProgram) {
  const auto s = arm_of();
  EmulatedArm arm(s);
  arm.program_ends_at = 20;
  UrDriver driver(s);
  const auto failure = failure_in_motion(driver);
  ASSERT_TRUE(failure);
  EXPECT_THAT(failure->what(), HasSubstr("the arm's program has ended: no torque came for 0.02 s"));
}

TEST(UrDriver, LeavesAnArmWithoutTorquesToItsProgramWhichEnds) {
  const auto s = arm_of();
  EmulatedArm arm(s);
  UrDriver driver(s);
  driver.start();
  driver.hold(Vector::Zero(6), 0);
  const auto failure = failure_of([&] {
    for (int k = 0; k < 12; ++k) driver.rest(0);  // 24 ms
  });
  ASSERT_TRUE(failure);
  EXPECT_THAT(failure->what(), HasSubstr("the arm's program has ended"));
  EXPECT_FALSE(arm.program_runs);
}

TEST(UrDriver, SaysThatASilentArmStopsByItself) {
  const auto s = arm_of();
  EmulatedArm arm(s);
  arm.silent_from = 20;
  UrDriver driver(s);
  const auto failure = failure_in_motion(driver);
  ASSERT_TRUE(failure);
  EXPECT_THAT(failure->what(), HasSubstr("sent no state for 100 ms"));
  EXPECT_THROW(driver.stop(), plant::StopsByItself);
}

}  // namespace
}  // namespace tachless::ur

#include "certify/feasibility.h"

#include <fmt/core.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tests/analysis/linear/scenarios.h"
#include "tests/support/limited_elbow.h"

namespace tachless::certify {
namespace {

using namespace linear;
using namespace linear::testing;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(Feasibility, OfTheShippedScenariosStandsAgainstNone) {
  for (const char* name : {"paper_rigid", "practical_flexible", "iiwa_point_to_point"}) {
    const Feasibility result = feasibility(linear::testing::shipped(name));
    EXPECT_THAT(result.impossible, IsEmpty()) << name;
    EXPECT_THAT(result.doubtful, IsEmpty()) << name;
  }
}

/// f h of the paper's 5 Hz at 50 us, and its speed, in closed form; torque at rest is gravity's.
TEST(Feasibility, KnowsSpeedFrequencyAndTorqueOfASinusoid) {
  const Feasibility result = feasibility(linear::testing::shipped("paper_rigid"));
  ASSERT_EQ(result.joints.size(), 2U);
  for (const JointDemand& joint : result.joints) {
    EXPECT_NEAR(joint.speed, 1, 1e-4);  // 2000 instants of one period: cos(pi / 2000) off
    EXPECT_NEAR(joint.cycles_per_tick, 5 * 5e-5, 1e-3 * 5 * 5e-5);
    EXPECT_FALSE(joint.torque_limit);
    EXPECT_GT(joint.moving, joint.at_rest);
  }
}

std::vector<JointDemand> demands_of(const std::string& sinusoid, const std::string& duration) {
  return feasibility(linear::testing::shipped("practical_rigid",
                                              {duration, "reference={sinusoid: " + sinusoid + "}"}))
      .joints;
}

TEST(Feasibility, SeesTheSpeedOfALongRunsSinusoid) {
  // At rest at every half second.
  const auto joints = demands_of("{amplitude_rad: 0.1, frequency_hz: 2, phase_rad: 1.5707963}",
                                 "loop.duration_s=1000");
  // At 50 instants a period the largest would be at most cos(pi / 50) off.
  for (const JointDemand& joint : joints) EXPECT_NEAR(joint.speed, 1.2566, 0.003);
}

TEST(Feasibility, SeesTheSpeedOfAFastSinusoid) {
  // At 25 Hz, 10 ms are a quarter of a period. The instants begin at pi/4: |cos| is 0.7071 at each.
  const auto joints =
      demands_of("{amplitude_rad: 0.00636619772, frequency_hz: 25, phase_rad: 0.78539816}",
                 "loop.duration_s=20");
  // 50 instants a period would be at most 0.2 % off.
  for (const JointDemand& joint : joints) EXPECT_NEAR(joint.speed, 1, 0.002);
}

/// The elbow moves by 0.5 rad at some 1 rad/s toward the end of its range and stops 0.1 rad before.
TEST(Feasibility, NamesTheTimeAtWhichAJointIsTooFastForTheEndOfItsRange) {
  const auto demand = [](const std::string& deceleration) {
    return feasibility(with_limited_elbow(
        linear::testing::shipped(
            "practical_rigid", {"reference={point_to_point: {from_rad: [0, 0], to_rad: [0, 0.5], "
                                "start_s: 0.1, duration_s: 1.2}}",
                                "plant.initial={position_rad: [0, 0], velocity_rad_per_s: [0, 0]}",
                                "loop.duration_s=2"}),
        R"(lower="-3" upper="0.6" velocity="10"/><position_based_velocity_limits deceleration_limit=")" +
            deceleration + R"(" velocity_offset="0.1")"));
  };
  const Feasibility wide = demand("100");
  EXPECT_THAT(wide.impossible, IsEmpty());
  ASSERT_TRUE(wide.joints[1].tight_speed);
  EXPECT_FALSE(wide.joints[0].tight_speed);
  EXPECT_LT(wide.joints[1].tight_speed->speed, wide.joints[1].tight_speed->limit);
  const Feasibility narrow = demand("0.5");
  EXPECT_THAT(narrow.impossible, ElementsAre(AllOf(HasSubstr("joint 2 (elbow) is to move at "),
                                                   HasSubstr("so near to the end of its range"))));
  const TightSpeed& tight = *narrow.joints[1].tight_speed;
  EXPECT_GT(tight.at_s, 0.7) << "later than the fastest instant, the middle of the motion";
  EXPECT_LT(tight.at_s, 1.3);
  EXPECT_NEAR(tight.limit, std::sqrt(2 * 0.5 * (0.6 - tight.position - 0.02 * tight.speed)) - 0.1,
              1e-12)
      << "20 ms ahead, as the guard of a run";
}

TEST(Feasibility, NamesTheJointThatCannotHoldItself) {
  const Feasibility held =
      feasibility(linear::testing::shipped("regulation", {"reference.hold.position_rad=[1.5, 0]",
                                                          "plant.drive.torque_limit_Nm=[30, 30]"}));
  EXPECT_THAT(held.impossible,
              ElementsAre(AllOf(HasSubstr("joint 1 ("), HasSubstr("to stand still"),
                                HasSubstr("its limit is 30 N m"))));
  const Feasibility moving =
      feasibility(shipped("paper_rigid", {"plant.drive.torque_limit_Nm=[100, 100]"}));
  EXPECT_THAT(moving.impossible, ElementsAre(HasSubstr("to follow the reference")));
}

/// Behind stiff springs the rotor's acceleration is the reference's, 31.4 rad/s2. (At the
/// scenario's own stiffness the springs' second derivative nearly cancels it.)
TEST(Feasibility, CountsTheRotorsOfFlexibleJoints) {
  const auto torque = [](const std::string& rotors) {
    const scenario::Scenario scenario = linear::testing::shipped(
        "practical_flexible", {"robot.joints.flexible.stiffness_Nm_per_rad=1e7",
                               "robot.joints.flexible.rotor_inertia_kgm2=" + rotors});
    return feasibility(scenario).joints[0].moving;
  };
  EXPECT_NEAR(torque("[1.1, 0.1]") - torque("[0.1, 0.1]"), 31.4, 1);
}

/// The motion is slow and ends where gravity is largest, so that the largest torque is there. Link
/// and motor move the same way until just before they stop.
TEST(Feasibility, CountsDryFriction) {
  const auto torque = [](const std::string& scenario, const std::string& friction) {
    return feasibility(
               linear::testing::shipped(
                   scenario, {"reference={point_to_point: {from_rad: 0, to_rad: [1, 0], "
                              "start_s: 0, duration_s: 50}}",
                              "loop.duration_s=50", "plant.initial.position_rad=[0, 0]", friction}))
        .joints[0]
        .moving;
  };
  const auto added = [&](const std::string& scenario, const std::string& key) {
    return torque(scenario, key + "=[5, 1]") - torque(scenario, key + "=[0, 0]");
  };
  // Within the last 0.2 s that it moves gravity changes by less than 1e-3 N m.
  EXPECT_NEAR(added("practical_rigid", "plant.drive.coulomb_friction_Nm"), 5, 1e-3);
  EXPECT_NEAR(added("practical_flexible", "robot.joints.flexible.motor_coulomb_friction_Nm"), 5,
              1e-3);
}

TEST(Feasibility, DoubtsDegreesAndRadiansPerSecondNamingKeyValueAndMistake) {
  const Feasibility degrees = feasibility(
      linear::testing::shipped("regulation", {"plant.initial.position_rad=[30, 6.28]"}));
  EXPECT_THAT(degrees.doubtful,
              ElementsAre("plant.initial.position_rad: 30 rad for joint 1 (shoulder) is more than "
                          "a full turn; angles are in rad, were degrees given?"));
  for (const char* hz : {"150", "200", "100.1"}) {
    const Feasibility fast = feasibility(
        shipped("practical_rigid", {fmt::format("reference.sinusoid.frequency_hz=[{}, 100]", hz),
                                    "reference.sinusoid.amplitude_rad=[0.001, 0.03]"}));
    EXPECT_THAT(fast.doubtful,
                ElementsAre(fmt::format(
                    "reference.sinusoid.frequency_hz: {} Hz for joint 1 (shoulder) is more than a "
                    "tenth of the sampling rate of 1000 Hz; frequencies are in Hz, was rad/s "
                    "given?",
                    hz)));
  }
}

TEST(Feasibility, DoubtsTheFastestTermOfASumAndAMotionOfAFewTicks) {
  const Feasibility sum = feasibility(linear::testing::shipped(
      "practical_rigid", {"reference={multi_sine: {terms: [{amplitude_rad: 0.1, frequency_hz: 1}, "
                          "{amplitude_rad: [0, 0.001], frequency_hz: 314}]}}"}));
  EXPECT_THAT(sum.doubtful,
              ElementsAre(HasSubstr("reference.multi_sine.terms: 314 Hz for joint 2 (elbow)")));
  // A ninth-degree polynomial over T has sup|a| / sup|v| of about 3.8 / T: 0.6 / T Hz.
  const Feasibility motion = feasibility(
      shipped("practical_rigid", {"loop.duration_s=0.01",
                                  "reference={point_to_point: {from_rad: 0, to_rad: [0.001, 0], "
                                  "start_s: 0, duration_s: 0.003}}"}));
  EXPECT_THAT(motion.doubtful, ElementsAre(AllOf(HasSubstr("reference.point_to_point: "),
                                                 HasSubstr("times are in s"))));
}

}  // namespace
}  // namespace tachless::certify

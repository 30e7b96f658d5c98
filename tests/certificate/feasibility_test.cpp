#include "certificate/feasibility.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/certificate/scenarios.h"

namespace tachless::certificate {
namespace {

using namespace testing;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(Feasibility, OfTheShippedScenariosStandsAgainstNone) {
  for (const char* name : {"paper_rigid", "practical_flexible", "iiwa_point_to_point"}) {
    const Feasibility result = feasibility(shipped(name));
    EXPECT_THAT(result.impossible, IsEmpty()) << name;
    EXPECT_THAT(result.doubtful, IsEmpty()) << name;
  }
}

/// f h of the paper's 5 Hz at 50 us, and its speed, in closed form; torque at rest is gravity's.
TEST(Feasibility, KnowsSpeedFrequencyAndTorqueOfASinusoid) {
  const Feasibility result = feasibility(shipped("paper_rigid"));
  ASSERT_EQ(result.joints.size(), 2U);
  for (const JointDemand& joint : result.joints) {
    EXPECT_NEAR(joint.speed, 1, 1e-4);  // 2000 instants of ten periods
    EXPECT_NEAR(joint.cycles_per_tick, 5 * 5e-5, 1e-3 * 5 * 5e-5);
    EXPECT_FALSE(joint.torque_limit);
    EXPECT_GT(joint.moving, joint.at_rest);
  }
}

TEST(Feasibility, NamesTheJointThatCannotHoldItself) {
  const Feasibility held =
      feasibility(shipped("regulation", {"reference.hold.position_rad=[1.5, 0]",
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
    const experiment::Scenario scenario =
        shipped("practical_flexible", {"robot.joints.flexible.stiffness_Nm_per_rad=1e7",
                                       "robot.joints.flexible.rotor_inertia_kgm2=" + rotors});
    return feasibility(scenario).joints[0].moving;
  };
  EXPECT_NEAR(torque("[1.1, 0.1]") - torque("[0.1, 0.1]"), 31.4, 1);
}

TEST(Feasibility, DoubtsDegreesAndRadiansPerSecond) {
  const Feasibility degrees =
      feasibility(shipped("regulation", {"plant.initial.position_rad=[30, 0]"}));
  EXPECT_THAT(degrees.doubtful, ElementsAre(HasSubstr("were degrees meant?")));
  const Feasibility fast =
      feasibility(shipped("practical_rigid", {"reference.sinusoid.frequency_hz=[150, 5]",
                                              "reference.sinusoid.amplitude_rad=[0.001, 0.03]"}));
  EXPECT_THAT(fast.doubtful, ElementsAre(HasSubstr("of a cycle in one tick")));
}

}  // namespace
}  // namespace tachless::certificate

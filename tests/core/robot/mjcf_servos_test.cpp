// Position actuators of MuJoCo models, the options of their steps, and what is beside the robot.

#include "robot/mjcf_servos.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>

#include "robot/mjcf_scene.h"

namespace tachless::robot {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

/// Reads two joints with these actuators, and `more` beside them.
MjcfServos servos(const std::string& actuators, const std::string& more = "") {
  const std::string text = R"(<mujoco>)" + more + R"(
    <worldbody><body><joint name="a" ref="90"/><geom size="1"/>
      <body><joint name="b" type="slide" ref="0.5"/><geom size="1"/></body></body></worldbody>
    <actuator>)" + actuators +
                           "</actuator></mujoco>";
  return read_mjcf_servos(text, "arm.xml", [](const std::string&) { return std::string(); });
}
MjcfServo servo(const std::string& actuator, const std::string& more = "") {
  const MjcfServos read = servos(actuator, more);
  EXPECT_EQ(read.servos.size(), 1U);
  return read.servos.at(0);
}
std::string refusal_of_servos(const std::string& actuators, const std::string& more = "") {
  try {
    (void)servos(actuators, more);
  } catch (const std::invalid_argument& refused) {
    return refused.what();
  }
  return "accepted";
}

TEST(MjcfServos, HaveTheGainsOfPositionAndGeneral) {
  for (const char* each :
       {R"(<position joint="a" kp="200" kv="9"/>)", R"(<intvelocity joint="a" kp="200" kv="9"/>)",
        R"(<general joint="a" gainprm="200" biastype="affine" biasprm="0 -200 -9"/>)",
        R"(<general jointinparent="a" gainprm="1" biastype="affine" biasprm="5 -200 -9"/>)",
        R"(<position joint="a" kp="2" kv="0.09" gear="-10"/>)"}) {
    const MjcfServo read = servo(each);
    EXPECT_EQ(read.joint, "a") << each;
    EXPECT_NEAR(read.kp, 200, 1e-9) << each;
    EXPECT_NEAR(read.kv, 9, 1e-9) << each;
  }
  EXPECT_EQ(servo(R"(<position joint="a"/>)").kp, 1);
  EXPECT_EQ(servo(R"(<velocity joint="a" kv="7"/>)").kv, 7);
  EXPECT_EQ(servo(R"(<velocity joint="a" kv="7"/>)").kp, 0);
}

TEST(MjcfServos, HaveTheGainsOfTheirClass) {
  const std::string general = R"(<default><default class="x">
    <general gainprm="300" biastype="affine" biasprm="0 -300 -20"/></default></default>)";
  EXPECT_EQ(servo(R"(<general joint="a" class="x"/>)", general).kp, 300);
  EXPECT_EQ(servo(R"(<general joint="a" class="x"/>)", general).kv, 20);
  EXPECT_EQ(servo(R"(<position joint="a" class="x"/>)", general).kp, 300);
  EXPECT_EQ(servo(R"(<position joint="a" class="x" kp="5"/>)", general).kp, 5);
  EXPECT_EQ(servo(R"(<position joint="a" class="x" kp="5"/>)", general).kv, 20);
  const std::string position = R"(<default><position kp="50" kv="4"/></default>)";
  EXPECT_EQ(servo(R"(<position joint="a"/>)", position).kp, 50);
  EXPECT_EQ(servo(R"(<general joint="a"/>)", position).kv, 4);
}

TEST(MjcfServos, MayHaveARatioOfDampingInPlaceOfKv) {
  const MjcfServo read = servo(R"(<position joint="a" kp="50" dampratio="0.7"/>)");
  EXPECT_EQ(read.damping_ratio, 0.7);
  EXPECT_EQ(read.kv, 0);
}

TEST(MjcfServos, LeaveOutWhatHasNoConstantGains) {
  const MjcfServos read = servos(R"(
    <motor joint="a"/><general joint="b"/><muscle joint="a"/>
    <general joint="b" gaintype="affine" gainprm="1 1" biastype="affine" biasprm="0 -1 0"/>
    <position name="tool" site="tip"/>)");
  EXPECT_EQ(read.servos.size(), 0U);
  EXPECT_THAT(read.warnings,
              ElementsAre(HasSubstr("<muscle>"), HasSubstr("<general> '' has no constant kp"),
                          HasSubstr("<position> 'tool' acts on no joint")));
}

TEST(MjcfServos, HaveTheStepAndIntegratorOfTheLastOption) {
  EXPECT_EQ(servos("").integrator, "Euler");
  EXPECT_EQ(servos("").step_s, 0.002);
  EXPECT_TRUE(servos("").implicit_joint_damping);
  const MjcfServos read =
      servos("", R"(<option timestep="0.01" integrator="RK4"/><option integrator="implicitfast">
    <flag eulerdamp="disable"/></option>)");
  EXPECT_EQ(read.integrator, "implicitfast");
  EXPECT_EQ(read.step_s, 0.01);
  EXPECT_FALSE(read.implicit_joint_damping);
  EXPECT_NEAR(read.reference.at("a"), std::numbers::pi / 2, 1e-15);
  EXPECT_EQ(read.reference.at("b"), 0.5);
}

TEST(MjcfServos, RefuseWhatMuJoCoDoesNotKnow) {
  EXPECT_THAT(refusal_of_servos("", R"(<option integrator="euler"/>)"),
              HasSubstr("integrator=\"euler\"; allowed: Euler, RK4"));
  EXPECT_THAT(refusal_of_servos("", R"(<option timestep="0"/>)"), HasSubstr("timestep"));
  EXPECT_THAT(refusal_of_servos(R"(<position joint="a" kp="-1"/>)"), HasSubstr("kp is -1"));
  EXPECT_THAT(
      refusal_of_servos(R"(<general joint="a" gainprm="9" biastype="affine" biasprm="0 9 0"/>)"),
      HasSubstr("kp is -9"));
}

TEST(MjcfScene, HasAShapeOrABodyBesideTheRobot) {
  const auto scene = [](const std::string& more) {
    const std::string robot = R"(<body><geom size="1"/><joint name="a"/></body><light/>)";
    return has_surroundings("<mujoco><worldbody>" + robot + more + "</worldbody></mujoco>",
                            "arm.xml", [](const std::string&) { return std::string(); });
  };
  EXPECT_FALSE(scene(""));
  EXPECT_FALSE(scene(R"(<frame><body><body><joint name="b" type="slide"/></body></body></frame>)"));
  EXPECT_TRUE(scene(R"(<geom type="plane" size="1 1 1"/>)"));
  EXPECT_TRUE(scene(R"(<body><freejoint/><geom size="1"/></body>)"));
  EXPECT_TRUE(scene(R"(<frame pos="0 0 1"><body><geom size="1"/></body></frame>)"));
}

}  // namespace
}  // namespace tachless::robot

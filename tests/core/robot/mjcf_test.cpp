// MuJoCo models (MJCF) as descriptions of robots, without MuJoCo.

#include "robot/mjcf.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <random>

#include "robot/dynamics.h"
#include "robot/kinematics.h"
#include "robot/urdf_xml.h"
#include "tests/core/robot/mjcf_models.h"

namespace tachless::robot {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

Description described(const std::string& text,
                      const std::map<std::string, std::string>& files = {}) {
  return description_of_mjcf(text, "arm.xml",
                             [&](const std::string& file) { return files.at(file); });
}
Model model(const std::string& text, const std::map<std::string, std::string>& files = {}) {
  return model_from_urdf(described(text, files).urdf, "arm.xml");
}
std::string refusal(const std::string& text, const std::map<std::string, std::string>& files = {}) {
  try {
    (void)model(text, files);
  } catch (const std::invalid_argument& refused) {
    return refused.what();
  }
  return "accepted";
}
std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

/// An arm of two joints; `more` is beside its bodies, `inside` in the second.
std::string arm(const std::string& inside = "", const std::string& more = "",
                const std::string& compiler = "angle=\"radian\"") {
  return R"(<mujoco model="arm">
  <compiler )" +
         compiler + R"(/>
  <worldbody>
    <body name="upper" pos="0 0 0.2">
      <joint name="shoulder" axis="0 1 0" range="-2 2"/>
      <inertial pos="0 0 0.1" mass="2" diaginertia="0.02 0.02 0.01"/>
      <body name="lower" pos="0 0 0.3">
        <joint name="elbow" axis="0 1 0" range="-2 2"/>
        <inertial pos="0 0 0.1" mass="1" diaginertia="0.01 0.01 0.005"/>)" +
         inside + R"(
      </body>
    </body>
  </worldbody>
)" + more +
         "</mujoco>";
}

void expect_equal_mechanics(const Model& a, const Model& b) {
  ASSERT_EQ(a.joint_names, b.joint_names);
  std::mt19937 random(1);
  for (int k = 0; k < 20; ++k) {
    Vector q(a.num_joints), v(a.num_joints);
    for (int i = 0; i < a.num_joints; ++i) {
      q[i] = random() / 2147483648.0 - 1;
      v[i] = random() / 2147483648.0 - 1;
    }
    Matrix M_a, M_b;
    Vector bias_a, bias_b;
    set_equations_of_motion(a, q, v, M_a, bias_a);
    set_equations_of_motion(b, q, v, M_b, bias_b);
    EXPECT_LT((M_a - M_b).cwiseAbs().maxCoeff(), 1e-13);        // rounding
    EXPECT_LT((bias_a - bias_b).cwiseAbs().maxCoeff(), 1e-12);  // rounding
  }
}

TEST(Mjcf, IsKnownByItsRootElement) {
  EXPECT_TRUE(is_mjcf("<mujoco/>"));
  EXPECT_TRUE(
      is_mjcf("\xef\xbb\xbf<?xml version=\"1.0\"?>\n<!-- <robot> -->\n<mujoco model=\"a\">"));
  for (const char* other : {"", "<robot><mujoco/></robot>", "<mujocoinclude/>", "mujoco", "<!--"}) {
    EXPECT_FALSE(is_mjcf(other)) << other;
  }
}

TEST(Mjcf, GivesTheModelOfTheSameUrdf) {
  const Model read = model(arm());
  const Model written = model_from_urdf(R"(<robot name="arm"><link name="world"/>
    <link name="upper"><inertial><origin xyz="0 0 0.1"/><mass value="2"/>
      <inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <link name="lower"><inertial><origin xyz="0 0 0.1"/><mass value="1"/>
      <inertia ixx="0.01" iyy="0.01" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="shoulder" type="revolute"><parent link="world"/><child link="upper"/>
      <origin xyz="0 0 0.2"/><axis xyz="0 1 0"/><limit lower="-2" upper="2"/></joint>
    <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/>
      <origin xyz="0 0 0.3"/><axis xyz="0 1 0"/><limit lower="-2" upper="2"/></joint></robot>)",
                                        "a");
  expect_equal_mechanics(read, written);
  EXPECT_EQ(read.lower, written.lower);
  EXPECT_EQ(read.upper, written.upper);
}

TEST(Mjcf, AppliesTheClassesOfJointsAndActuators) {
  const Model read = model(testing::nested_model);
  EXPECT_THAT(read.joint_names, ElementsAre("yaw", "pitch", "lift", "roll"));
  EXPECT_THAT(read.rotor_inertia, ElementsAre(0.02, 0.02, 0.02, 0.003));
  EXPECT_THAT(read.damping, ElementsAre(0.5, 0.5, 0.5, 0.5));
  EXPECT_THAT(read.friction, ElementsAre(0, 0, 0, 0.1));
  EXPECT_THAT(read.effort_limit, ElementsAre(60, 40, Model::unlimited, 10));
  EXPECT_DOUBLE_EQ(read.lower[0], -M_PI / 2);
  EXPECT_DOUBLE_EQ(read.upper[1], 100 * M_PI / 180);
  EXPECT_EQ(read.upper[2], 0.4);
}

TEST(Mjcf, FramesMoveBodiesJointsAndGeoms) {
  const std::string with_frames = R"(<mujoco><compiler angle="radian"/>
    <default><default class="d"><joint axis="0 1 0" damping="2"/></default></default>
    <worldbody><frame pos="0 0 0.2" euler="0.3 0 0" childclass="d">
      <body name="a" pos="0.1 0 0">
        <frame pos="0 0.1 0" euler="0 0 0.5"><joint name="j" pos="0.02 0 0"/>
          <frame pos="0 0 0.1"><geom type="sphere" size="0.1" pos="0.2 0 0"/></frame></frame>
      </body></frame></worldbody></mujoco>)";
  const double s = std::sin(0.5), c = std::cos(0.5);
  const std::string without = fmt::format(
      R"(<mujoco><compiler angle="radian"/><worldbody>
      <body name="a" pos="0.1 0 0.2" euler="0.3 0 0">
        <joint name="j" damping="2" axis="{} {} 0" pos="{} {} 0"/>
        <geom type="sphere" size="0.1" pos="{} {} 0.1"/>
      </body></worldbody></mujoco>)",
      -s, c, 0.02 * c, 0.1 + 0.02 * s, 0.2 * c, 0.1 + 0.2 * s);
  // The frame turns about the world's x axis, along which the body lies.
  const Model framed = model(with_frames), plain = model(without);
  EXPECT_EQ(framed.damping[0], 2);
  expect_equal_mechanics(framed, plain);
  const Vector q = Vector::Constant(1, 0.7);
  EXPECT_LT((frame_pose(framed, "a", q).p - frame_pose(plain, "a", q).p).norm(), 1e-15);
}

TEST(Mjcf, IncludesStandInTheirPlace) {
  const std::string whole =
      arm("", "<actuator><motor joint=\"elbow\" ctrlrange=\"-3 3\"/></actuator>");
  const Model read =
      model(R"(<mujoco><include file="parts/arm.xml"/><include file="drives.xml"/></mujoco>)",
            {{"parts/arm.xml", arm()},
             {"drives.xml", "<list><actuator><include file=\"one.xml\"/></actuator></list>"},
             {"one.xml", "<some><motor joint=\"elbow\" ctrlrange=\"-3 3\"/></some>"}});
  expect_equal_mechanics(read, model(whole));
  EXPECT_EQ(read.effort_limit[1], 3);
  EXPECT_THAT(
      refusal("<mujoco><include file=\"a\"/><include file=\"a\"/></mujoco>", {{"a", "<a/>"}}),
      HasSubstr("a is included twice"));
  EXPECT_THAT(refusal("<mujoco>\n<include file=\"a\"/></mujoco>",
                      {{"a", "<a><worldbody>\n<bdy/></worldbody></a>"}}),
              StartsWith("arm.xml: a: line 2: <bdy> in <worldbody> is not read; the nearest known "
                         "name is body"));
}

TEST(Mjcf, EqualitiesOfJointsAreMimicJoints) {
  const Model read = model(testing::gripper_model);
  EXPECT_THAT(read.joint_names, ElementsAre("elbow", "left"));
  ASSERT_EQ(read.bodies.size(), 4U);
  EXPECT_EQ(read.bodies[2].multiplier, 1);
  EXPECT_EQ(read.bodies[3].multiplier, -3);
  EXPECT_DOUBLE_EQ(read.bodies[3].offset, 0.2 + 0.1);
  EXPECT_DOUBLE_EQ(read.rotor_inertia[1], 0.2);
}

TEST(Mjcf, ForceLimitsAreThoseOfTheWeakestPart) {
  const auto effort = [](const std::string& drive, const std::string& joint = "") {
    return model(replaced(arm("", "<actuator>" + drive + "</actuator>"), "<joint name=\"elbow\"",
                          "<joint name=\"elbow\" " + joint))
        .effort_limit[1];
  };
  EXPECT_EQ(effort("<motor joint='elbow' gear='50' ctrlrange='-1 1'/>"), 50);
  EXPECT_EQ(effort("<motor joint='elbow' gear='50' ctrlrange='-1 1' forcerange='-0.5 0.5'/>"), 25);
  EXPECT_EQ(effort("<general joint='elbow' gainprm='4' ctrlrange='-2 2'/>"), 8);
  EXPECT_EQ(effort("<position joint='elbow' kp='4' ctrlrange='-2 2'/>"), Model::unlimited);
  EXPECT_EQ(effort("<position joint='elbow' forcerange='-7 9'/>"), 7);
  EXPECT_EQ(effort("<position joint='elbow' forcerange='-7 7'/>", "actuatorfrcrange='-3 3'"), 3);
  EXPECT_EQ(effort("<motor joint='elbow' ctrlrange='-1 1' ctrllimited='false'/>"),
            Model::unlimited);
}

TEST(Mjcf, KeyframeHomeIsTheStart) {
  const auto start = [](const std::string& keys) {
    return described(arm("", "<keyframe>" + keys + "</keyframe>")).start;
  };
  EXPECT_THAT(start("<key qpos='1 2'/><key name='home' qpos='0.5 -0.5'/>"),
              ElementsAre(std::pair("elbow", -0.5), std::pair("shoulder", 0.5)));
  EXPECT_THAT(start("<key name='up' ctrl='1'/>"), IsEmpty());
  const std::string cube = R"(<worldbody><body name="cube" pos="1 0 0"><freejoint/>
    <geom type="box" size="1 1 1"/></body></worldbody>)";
  const Description scene =
      described(replaced(arm("", "<keyframe><key qpos='9 9 9 1 0 0 0 0.5 -0.5'/></keyframe>"),
                         "  <worldbody>", cube + "<worldbody>"));
  EXPECT_EQ(scene.start.at("shoulder"), 0.5);
  EXPECT_THAT(scene.warnings,
              ElementsAre(HasSubstr("body 'cube' is free and carries no joint of the robot")));
}

TEST(Mjcf, GravcompOfAllBodiesIsAnArmThatCarriesItself) {
  std::string all = arm();
  for (const char* body : {"upper", "lower"}) {
    const std::string name = fmt::format("name=\"{}\"", body);
    EXPECT_FALSE(described(all).adds_gravity);
    all = replaced(all, name, name + " gravcomp=\"1\"");
  }
  EXPECT_TRUE(described(all).adds_gravity);
  EXPECT_THAT(described(all).warnings, IsEmpty());
  EXPECT_THAT(described(replaced(all, "gravcomp=\"1\"", "")).warnings,
              ElementsAre(HasSubstr("gravcomp=\"1\" is not read: not all bodies")));
}

TEST(Mjcf, GeomsOfShownGroupsAreVisuals) {
  const std::string urdf =
      described(arm(R"(<geom type="mesh" mesh="hand" pos="0 0 1" quat="0 1 0 0" material="red"/>
    <geom type="capsule" size="0.1 0.2" rgba="0 1 0 1"/><geom type="box" size="1 2 3" group="3"/>)",
                    R"(<asset><mesh file="parts/hand.stl" scale="1e-3 1e-3 1e-3"/>
    <material name="red" rgba="1 0 0 1"/></asset>)",
                    R"(angle="radian" meshdir="meshes")"))
          .urdf;
  EXPECT_THAT(urdf,
              AllOf(HasSubstr("filename=\"meshes/parts/hand.stl\" scale=\"0.001 0.001 0.001\""),
                    HasSubstr("xyz=\"0 0 1\" quat_xyzw=\"1 0 0 0\""), HasSubstr("rgba=\"1 0 0 1\""),
                    HasSubstr("radius=\"0.1\" length=\"0.4\"")));
  EXPECT_THAT(urdf, ::testing::Not(HasSubstr("<box")));
}

TEST(Mjcf, RefusesWhatItDoesNotRead) {
  const auto line = [](int n, const std::string& what) {
    return AllOf(StartsWith(fmt::format("arm.xml: line {}: ", n)), HasSubstr(what));
  };
  const std::string plain = arm();
  const auto with = [&](const std::string& from, const std::string& to) {
    return refusal(replaced(plain, from, to));
  };
  EXPECT_THAT(with("axis=", "axes="),
              line(5, "attribute axes, which is not read; the nearest known"));
  EXPECT_THAT(with("<worldbody>", "<worldbody childclass=\"c\">"),
              line(3, "has the attribute childclass, which is not read"));
  EXPECT_THAT(with("<inertial", "<inertia"), line(6, "<inertia> in <body> is not read"));
  EXPECT_THAT(with("range=\"-2 2\"", "range=\"-2 x\""), line(5, "2 finite numbers"));
  EXPECT_THAT(with("range=\"-2 2\"", "range=\"2 -2\""), line(5, "the lower end first"));
  EXPECT_THAT(with("range=\"-2 2\"", "stiffness=\"3\""), line(5, "a spring is not read"));
  EXPECT_THAT(with("axis=\"0 1 0\"", "axis=\"0 0 0\""), line(5, "length 0"));
  EXPECT_THAT(with("axis=\"0 1 0\"", "type=\"hing\""), line(5, "allowed: hinge, slide"));
  EXPECT_THAT(with("axis=\"0 1 0\"", "type=\"ball\""), HasSubstr("type ball is not supported"));
  EXPECT_THAT(with("axis=\"0 1 0\"", "damping=\"-1\""), line(5, "a finite number from 0 on"));
  EXPECT_THAT(with("axis=\"0 1 0\"", "class=\"c\""), line(5, "class \"c\" is not among"));
  EXPECT_THAT(with("name=\"elbow\"", "name=\"shoulder\""), line(8, "'shoulder' is there twice"));
  EXPECT_THAT(with("name=\"upper\"", "name=\"a;b\""), line(4, "is not a name"));
  EXPECT_THAT(with("angle=\"radian\"", "angle=\"grad\""), line(2, "allowed: degree, radian"));
  EXPECT_THAT(with("angle=\"radian\"", "coordinate=\"global\""), line(2, "allowed: local"));
  EXPECT_THAT(with("angle=\"radian\"", "settotalmass=\"3\""), line(2, "settotalmass is not read"));
  EXPECT_THAT(with("angle=\"radian\"", "autolimits=\"false\""), line(5, "give limited="));
  EXPECT_THAT(with("mass=\"2\"", "mass=\"2\" fullinertia=\"1 1 1 0 0 0\""),
              line(6, "fullinertia beside diaginertia"));
  EXPECT_THAT(with("mass=\"2\"", "mass=\"2\" quat=\"1 0 0 0\" euler=\"0 0 1\""),
              line(6, "two orientations"));
  EXPECT_THAT(with("<inertial pos", "<replicate/><inertial pos"), line(6, "<replicate> in <body>"));
  EXPECT_THAT(with("</mujoco>", "<equality><weld body1='a'/></equality></mujoco>"),
              line(13, "<weld> in <equality> is not read"));
  EXPECT_THAT(
      with("</mujoco>", "<equality><joint joint1='elbow' joint2='elbo'/></equality></mujoco>"),
      line(13, "the nearest is elbow"));
  EXPECT_THAT(with("</mujoco>", "<tendon><spatial/></tendon></mujoco>"), line(13, "<spatial>"));
  EXPECT_THAT(with("</mujoco>", "<actuator><motor joint='x'/></actuator></mujoco>"),
              line(13, "names joint 'x', which is not in the robot"));
  EXPECT_THAT(with("</mujoco>", "<option><flag frictionloss='disable'/></option></mujoco>"),
              line(13, "frictionloss=\"disable\" is not read"));
  EXPECT_THAT(with("</mujoco>", "<keyframe><key qpos='1'/></keyframe></mujoco>"),
              line(13, "allowed: 2 finite numbers"));
  EXPECT_THAT(refusal("<mujoco><worldbody><body><joint/><geom type=\"mesh\" mesh=\"m\"/></body>"
                      "</worldbody></mujoco>"),
              line(1, "the mass of a mesh is not read"));
}

}  // namespace
}  // namespace tachless::robot

// Rotor inertia and friction by joint from a file of their own: robot.joint_parameters.
#include "scenario/joint_parameters.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <fstream>
#include <string>
#include <vector>

#include "tests/support/temporary_directory.h"

namespace tachless::scenario {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

/// Defaults of two classes, one inside of the other, and of a body's children.
constexpr const char* mjcf = R"(<?xml version="1.0"?>
<mujoco model="two">
  <default>
    <default class="arm">
      <joint armature="0.2" damping="1"/>
      <default class="small"><joint armature="0.05" frictionloss="0.3"/></default>
    </default>
  </default>
  <worldbody>
    <body name="a" childclass="arm">
      <joint name="shoulder" frictionloss="0.7"/>
      <body name="b"><joint name="elbow" class="small" damping="0.5"/><joint/></body>
    </body>
  </worldbody>
</mujoco>)";

constexpr const char* yaml =
    "shoulder: {rotor_inertia_kgm2: 0.2, viscous_friction_Nms_per_rad: 1, coulomb_friction_Nm: "
    "0.7}\n"
    "elbow: {rotor_inertia_kgm2: 0.05, viscous_friction_Nms_per_rad: 0.5, coulomb_friction_Nm: "
    "0.3}\n";

class JointParametersFile : public testing::Test {
 protected:
  Scenario scenario(const std::string& text, std::vector<std::string> overrides = {}) {
    std::ofstream(directory_ / "numbers") << text;
    overrides.push_back("robot.joint_parameters=" + (directory_ / "numbers").string());
    return load_scenario(TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml", overrides);
  }
  std::string refusal(const std::string& text) {
    try {
      scenario(text);
    } catch (const base::Failure& refused) {
      return refused.what();
    }
    return "accepted";
  }

  TemporaryDirectory directory_;
};

TEST_F(JointParametersFile, OfMuJoCoAndOfYamlFillRotorAndFrictionOfTheJointsByName) {
  for (const char* text : {mjcf, yaml}) {
    const Scenario s = scenario(text);
    EXPECT_EQ(s.robot.rigid_rotor_inertia_kgm2, Eigen::Vector2d(0.2, 0.05)) << text;
    EXPECT_EQ(s.plant.drive.viscous_friction_Nms_per_rad, Eigen::Vector2d(1, 0.5)) << text;
    EXPECT_EQ(s.plant.drive.coulomb_friction_Nm, Eigen::Vector2d(0.7, 0.3)) << text;
  }
}

TEST_F(JointParametersFile, OfMuJoCoHasItsOuterClassForAllJointsWhateverItsName) {
  const Scenario s = scenario(R"(<mujoco><default class="arm"><joint armature="0.2"/>
    <default class="small"><joint damping="3"/></default></default><worldbody>
    <body><joint name="shoulder"/><joint name="elbow" class="small"/></body></worldbody></mujoco>)");
  EXPECT_EQ(s.robot.rigid_rotor_inertia_kgm2, Eigen::Vector2d(0.2, 0.2));
  EXPECT_EQ(s.plant.drive.viscous_friction_Nms_per_rad, Eigen::Vector2d(0, 3));
}

TEST_F(JointParametersFile, IsNotNeededByTheRecordedScenario) {
  const Scenario s = scenario(mjcf);
  EXPECT_THAT(s.text, testing::Not(HasSubstr("joint_parameters")));
  const Scenario recorded = parse_scenario(s.text, s.robot.urdf_text, "log", {});
  EXPECT_EQ(recorded.digest, s.digest);
  EXPECT_EQ(recorded.robot.rigid_rotor_inertia_kgm2, s.robot.rigid_rotor_inertia_kgm2);
  EXPECT_EQ(recorded.plant.drive.coulomb_friction_Nm, s.plant.drive.coulomb_friction_Nm);
}

TEST_F(JointParametersFile, GivesWayToTheScenariosOwnNumbers) {
  const Scenario s = scenario(
      mjcf, {"plant.drive.coulomb_friction_Nm=9", "robot.joints={rigid: {rotor_inertia_kgm2: 8}}"});
  EXPECT_EQ(s.plant.drive.coulomb_friction_Nm, Eigen::Vector2d(9, 9));
  EXPECT_EQ(s.robot.rigid_rotor_inertia_kgm2, Eigen::Vector2d(8, 8));
  EXPECT_EQ(s.plant.drive.viscous_friction_Nms_per_rad, Eigen::Vector2d(1, 0.5));
}

TEST_F(JointParametersFile, ReplacesNothingThatIsWrong) {
  for (const char* wrong : {"robot.joints=flexibel", "plant={drive: junk}"}) {
    EXPECT_THROW(scenario(yaml, {wrong}), base::Failure) << wrong;
  }
}

TEST_F(JointParametersFile, IsNotPassedOverWhereAScenarioComesFromText) {
  const Scenario s = scenario(mjcf);
  EXPECT_THROW(parse_scenario(s.text, s.robot.urdf_text, "log", {"robot.joint_parameters=numbers"}),
               base::Failure);
}

TEST_F(JointParametersFile, IsRefusedWithWhatIsWrongInIt) {
  EXPECT_THAT(refusal("shoulder: {}\n"),
              AllOf(HasSubstr("robot.joint_parameters: it has no joint \"elbow\""),
                    HasSubstr("its joints: shoulder")));
  EXPECT_THAT(refusal("shoulder: {rotor_inertia: 1}\nelbow: {}\n"), HasSubstr("rotor_inertia"));
  EXPECT_THAT(refusal("shoulder: {coulomb_friction_Nm: -1}\nelbow: {}\n"), HasSubstr("-1"));
  EXPECT_THAT(refusal("<robot name='a'/>"), HasSubstr("no <mujoco> element: it is a URDF"));
  EXPECT_THAT(refusal("<mujoco><worldbody/></mujoco>"), HasSubstr("has no named joint"));
  const auto refusal_of_body = [&](const std::string& joint) {
    return refusal("<mujoco><worldbody><body>" + joint + "</body></worldbody></mujoco>");
  };
  EXPECT_THAT(refusal_of_body("<joint name='shoulder' damping='-1'/>"),
              HasSubstr("damping=\"-1\"; allowed: a finite number from 0 on"));
  EXPECT_THAT(refusal_of_body("<joint name='elbow' class='no'/>"),
              HasSubstr("class \"no\" is not among the defaults"));
  EXPECT_THAT(refusal("<mujoco><worldbody><joint name='elbow'/></worldbody></mujoco>"),
              HasSubstr("<joint> in <worldbody> is not read"));
  EXPECT_THAT(refusal("<mujoco><worldbody>"), HasSubstr("malformed XML"));
  EXPECT_THAT(refusal("<mujoco>" + std::string(100'000, '<')), HasSubstr("robot.joint_parameters"));
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  text.replace(text.find(from), from.size(), to);
  return text;
}

TEST_F(JointParametersFile, RefusesWhatChangesTheNumbersAndIsNotRead) {
  const std::array<std::array<std::string, 3>, 6> cases{{
      {"<default>", "<include file=\"d1.xml\"/><default>", "d1.xml: no such file"},
      {"</mujoco>",
       "<actuator><motor joint=\"elbow\" gear=\"100\" armature=\"1e-5\"/></actuator></mujoco>",
       "the armature of <motor> is not read; add gear^2 times it"},
      {"armature=\"0.2\"", "armatur=\"0.2\"",
       "the attribute armatur, which is not read; the nearest known name is armature"},
      {"damping=\"1\"", "damping=\"1 0 2\"", "coefficients of higher powers"},
      {"name=\"elbow\"", "name=\"shoulder\"", "<joint> 'shoulder': there are two; rename one"},
      {"<joint armature=\"0.2\"", "<joint/><joint armature=\"0.2\"", "<default> has two <joint>"},
  }};
  for (const auto& [from, to, expected] : cases) {
    EXPECT_THAT(refusal(replaced(mjcf, from, to)), HasSubstr(expected)) << to;
  }
  EXPECT_EQ(refusal(replaced(mjcf, "armature=\"0.2\"", "armature=\" 0.2 \"")), "accepted");
  EXPECT_EQ(refusal(replaced(mjcf, "damping=\"1\"", "damping=\"1 0 0\"")), "accepted");
}

}  // namespace
}  // namespace tachless::scenario

// A MuJoCo model as robot.urdf.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <string>
#include <vector>

#include "scenario/description.h"
#include "scenario/scenario.h"
#include "tests/support/temporary_directory.h"

namespace tachless::scenario {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

/// The arm; `gravcomp` is an attribute of its bodies.
std::string arm(const std::string& gravcomp = "") {
  return R"(<mujoco model="arm"><compiler angle="radian"/>
  <include file="defaults.xml"/>
  <worldbody>
    <body name="upper" )" +
         gravcomp + R"(><joint name="shoulder" axis="0 1 0" range="-2 2"/>
      <inertial pos="0 0 -0.5" mass="4" diaginertia="0.1 0.1 0.01"/>
      <body name="lower" pos="0 0 -1" )" +
         gravcomp + R"(><joint name="elbow" axis="0 1 0" range="-2 2"/>
        <inertial pos="0 0 -0.3" mass="2" diaginertia="0.05 0.05 0.01"/></body></body>
  </worldbody>
  <actuator><motor joint="shoulder" gear="100" ctrlrange="-1.5 1.5"/></actuator>
  <keyframe><key name="home" qpos="0.25 -0.5"/></keyframe></mujoco>)";
}

class MjcfScenario : public testing::Test {
 protected:
  MjcfScenario() {
    write("arm.xml", arm());
    write("floating.xml", arm("gravcomp=\"1\""));
    write(
        "defaults.xml",
        "<mujoco><default><joint armature=\"0.3\" damping=\"0.7\" frictionloss=\"0.2\"/></default>"
        "</mujoco>");
  }
  void write(const char* name, const std::string& text) const {
    std::ofstream(directory_ / name) << text;
  }
  Scenario load(std::vector<std::string> settings) const {
    settings.insert(settings.begin(), "robot.urdf=" + (directory_ / "arm.xml").string());
    return load_scenario(TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml", settings);
  }
  std::string refusal(const std::vector<std::string>& settings) const {
    try {
      load(settings);
    } catch (const base::Failure& refused) {
      return refused.what();
    }
    return "accepted";
  }

  TemporaryDirectory directory_;
};

TEST_F(MjcfScenario, HasRotorsFrictionAndLimitsOfTheModel) {
  const Scenario s = load({});
  EXPECT_THAT(s.model->joint_names, ElementsAre("shoulder", "elbow"));
  EXPECT_THAT(s.robot.rigid_rotor_inertia_kgm2, ElementsAre(0.3, 0.3));
  EXPECT_THAT(s.plant.drive.viscous_friction_Nms_per_rad, ElementsAre(0.7, 0.7));
  EXPECT_THAT(s.plant.drive.coulomb_friction_Nm, ElementsAre(0.2, 0.2));
  EXPECT_EQ(s.model->effort_limit[0], 150);
  EXPECT_TRUE(s.model->rotor_inertia.isZero(0)) << "the arm adds the rotors once";
}

TEST_F(MjcfScenario, KeepsTheScenariosOwnNumbers) {
  const Scenario s =
      load({"robot.joints={rigid: {rotor_inertia_kgm2: 8}}", "plant.drive.coulomb_friction_Nm=9"});
  EXPECT_THAT(s.robot.rigid_rotor_inertia_kgm2, ElementsAre(8, 8));
  EXPECT_THAT(s.plant.drive.coulomb_friction_Nm, ElementsAre(9, 9));
}

TEST_F(MjcfScenario, IsTheSameFromALogWithoutTheFiles) {
  const Scenario s = load({});
  const Scenario again = parse_scenario(s.text, s.robot.urdf_text, "log");
  EXPECT_EQ(again.digest, s.digest);
  EXPECT_EQ(again.robot.rigid_rotor_inertia_kgm2, s.robot.rigid_rotor_inertia_kgm2);
  EXPECT_EQ(again.model->bodies[1].I_Bcm, s.model->bodies[1].I_Bcm);
}

TEST_F(MjcfScenario, ThatCarriesItsWeightNeedsAWordOfTheScenario) {
  const std::string file = "robot.urdf=" + (directory_ / "floating.xml").string();
  EXPECT_THAT(refusal({file}), AllOf(HasSubstr("robot.urdf: "), HasSubstr("gravcomp=\"1\""),
                                     HasSubstr("robot.compensates: {gravity: true}")));
  EXPECT_EQ(refusal({file, "robot.compensates.gravity=true"}), "accepted");
  EXPECT_EQ(refusal({file, "robot.compensates.gravity=false"}), "accepted");
}

TEST_F(MjcfScenario, NamesLineAndFileOfAFault) {
  write("defaults.xml", "<mujoco><default>\n<joint armatur=\"1\"/></default></mujoco>");
  EXPECT_THAT(refusal({}), AllOf(HasSubstr("robot.urdf: "),
                                 HasSubstr("arm.xml: defaults.xml: line 2: <joint> has the "
                                           "attribute armatur")));
}

TEST_F(MjcfScenario, OfDesignBeginsInTheKeyframe) {
  const RobotFile file = robot_file(directory_ / "floating.xml", {});
  const robot::Model model = robot::model_from_urdf(file.urdf, "floating.xml", file.options);
  UrdfScenario of{"arm", "floating.xml"};
  of.from = start_posture(file, model);
  of.adds_gravity = file.adds_gravity;
  const std::string text = urdf_scenario(model, of);
  EXPECT_THAT(text, AllOf(HasSubstr("position_rad: [0.25, -0.5]"),
                          HasSubstr("compensates: {gravity: true}")));
  EXPECT_TRUE(parse_scenario(text, file.urdf, "arm.yaml").robot.compensates.gravity);
  robot::Model narrow = model;
  narrow.upper[0] = 0.1;
  EXPECT_EQ(start_posture(file, narrow).size(), 0) << "outside of the range";
}

}  // namespace
}  // namespace tachless::scenario

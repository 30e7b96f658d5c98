#include "experiment/scenario_keys.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

namespace tachless::experiment {
namespace {

using ::testing::HasSubstr;

TEST(ScenarioKeys, AreAllInTheDocumentationWithUnitDefaultAndRange) {
  std::ifstream file(TACHLESS_SOURCE_DIR "/docs/scenario.md");
  std::stringstream page;
  page << file.rdbuf();
  EXPECT_THAT(page.str(), HasSubstr(scenario_key_table()))
      << "put this table into docs/scenario.md:\n"
      << scenario_key_table();
}

TEST(ScenarioKeys, AreKnownWithTheirMapsAndTheGainsOfTheUsersChoice) {
  for (const char* path : {"name", "plant.initial", "loop.period_s", "controller.gains.anything",
                           "robot.joints.flexible", "reference.multi_sine.terms[3].phase_rad"}) {
    EXPECT_TRUE(is_scenario_key(path)) << path;
  }
  for (const char* path :
       {"", "loop.period", "controller.gains.kp.x", "plant.<name>", "loop.name"}) {
    EXPECT_FALSE(is_scenario_key(path)) << path;
  }
  EXPECT_TRUE(has_keys_below("reference.multi_sine.terms[0]"));
  EXPECT_TRUE(has_keys_below("controller.gains"));
  EXPECT_FALSE(has_keys_below("reference.waypoints.position_rad"));
}

TEST(ScenarioKeys, TheNearestOneIsFoundUnderItsOwnMapFirst) {
  const auto nearest = [](const std::string& path) {
    const std::string hint = known_keys_hint(path, {"kp", "kd"});
    const std::string before = "nearest known key is ";
    return hint.rfind(before, 0) == 0 ? hint.substr(before.size()) : hint;
  };
  EXPECT_EQ(nearest("loop.perod_s"), "loop.period_s");
  EXPECT_EQ(nearest("reference.hold.position"), "reference.hold.position_rad");
  EXPECT_EQ(nearest("plant.initial.position"), "plant.initial.position_rad");
  EXPECT_EQ(nearest("stiffness_Nm_per_rad"), "robot.joints.flexible.stiffness_Nm_per_rad");
  EXPECT_EQ(nearest("contoller"), "controller");
  EXPECT_EQ(nearest("kp"), "controller.gains.kp");
  EXPECT_EQ(nearest("controller.kd"), "controller.gains.kd");
  EXPECT_EQ(nearest("plant.period_s"), "loop.period_s");
}

TEST(ScenarioKeys, AreListedWhenNoneIsNear) {
  EXPECT_EQ(known_keys_hint("robot.joints.flexible.backlash"),
            "known keys of robot.joints.flexible: stiffness_Nm_per_rad, rotor_inertia_kgm2, "
            "motor_damping_Nms_per_rad");
  EXPECT_EQ(known_keys_hint("quux"),
            "known keys of a scenario: name, robot, plant, reference, controller, loop");
}

}  // namespace
}  // namespace tachless::experiment

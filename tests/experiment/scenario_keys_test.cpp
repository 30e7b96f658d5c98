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

TEST(ScenarioKeys, RangesAreWrittenAsIntervals) {
  EXPECT_EQ((Range{0, 1, true, false}).text(), "in (0, 1]");
  EXPECT_EQ((Range{0, std::numeric_limits<double>::infinity(), true, false}).text(), "> 0");
  EXPECT_EQ(Range{}.text(), "");
  EXPECT_FALSE((Range{0, 1, true, false}).contains(0));
  EXPECT_TRUE((Range{0, 1, true, false}).contains(1));
  EXPECT_FALSE(Range{}.contains(std::numeric_limits<double>::infinity()));
  EXPECT_FALSE(Range{}.contains(std::numeric_limits<double>::quiet_NaN()));
}

TEST(ScenarioKeys, TheNearestOneIsFoundUnderItsOwnMapFirst) {
  EXPECT_EQ(nearest_scenario_key("loop.perod_s"), "loop.period_s");
  EXPECT_EQ(nearest_scenario_key("reference.hold.position"), "reference.hold.position_rad");
  EXPECT_EQ(nearest_scenario_key("plant.initial.position"), "plant.initial.position_rad");
  EXPECT_EQ(nearest_scenario_key("stiffness_Nm_per_rad"),
            "robot.joints.flexible.stiffness_Nm_per_rad");
  EXPECT_EQ(nearest_scenario_key("contoller"), "controller");
}

}  // namespace
}  // namespace tachless::experiment

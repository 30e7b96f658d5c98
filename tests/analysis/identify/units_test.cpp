// Tables whose units, signs or columns are not those that their description says.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/analysis/identify/hidden_arm.h"
#include "tests/analysis/identify/table_of_motion.h"

namespace tachless::identify {
namespace {

using testing::HasSubstr;

const std::vector<Kind> default_kinds = {Kind::rotor, Kind::viscous, Kind::coulomb, Kind::delay};
const std::vector<Kind> every_unknown = {Kind::rotor, Kind::viscous, Kind::coulomb, Kind::inertia,
                                         Kind::offset};

Recording right() {
  const scenario::Scenario arm = scenario("practical_rigid", "20", 2);
  Recording table = table_of_motion(
      arm, *arm.model, 15, 0,
      [](Eigen::Index /*j*/, double v, double /*load*/) { return 2 * v + (v > 0 ? 1 : -1); });
  add_noise(table, 0.005);
  return table;
}

std::string complaint_on(const Recording& table, const std::vector<Kind>& kinds = default_kinds) {
  return identify({table}, kinds, {}, ignore).no_fit;
}

TEST(Units, ARightTableFits) {
  EXPECT_EQ(complaint_on(right()), "");
  EXPECT_EQ(complaint_on(right(), every_unknown), "");
}

TEST(Units, DegreesAreTold) {
  Recording table = right();
  table.q *= 180 / M_PI;
  EXPECT_THAT(complaint_on(table), HasSubstr("position_scale: 0.0174533"));
}

TEST(Units, ReversedTorquesAreTold) {
  Recording table = right();
  table.tau *= -1;
  EXPECT_THAT(complaint_on(table), HasSubstr("torque_scale: [-1, -1]"));
  EXPECT_THAT(complaint_on(table, every_unknown), HasSubstr("torque_scale: [-1, -1]"));
  table = right();
  table.tau.col(1) *= -1;
  EXPECT_THAT(complaint_on(table), HasSubstr("torque_scale: [1, -1]"));
}

TEST(Units, AFactorIsTold) {
  Recording table = right();
  table.tau *= 1000;
  EXPECT_THAT(complaint_on(table), HasSubstr("torque_scale: [0.001, 0.001]"));
}

TEST(Units, SwappedColumnsAreTold) {
  Recording table = right();
  table.tau.col(0).swap(table.tau.col(1));
  EXPECT_THAT(complaint_on(table), HasSubstr("torque_columns in the order [2, 1]"));
}

TEST(Units, ATableOfAnotherRobotIsRefusedWithWhatToCheck) {
  Recording table = right();
  table.tau = table.tau.colwise().reverse().eval();
  EXPECT_THAT(complaint_on(table), HasSubstr("the table does not fit the robot: the fit leaves"));
}

}  // namespace
}  // namespace tachless::identify

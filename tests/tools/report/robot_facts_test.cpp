#include "report/robot_facts.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "base/failure.h"
#include "tests/core/robot/robots.h"

namespace tachless::report {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(RobotFacts, AreThoseOfTheClosedForm) {
  const RobotFacts facts(robot::testing::two_link(), {0.5, -1});
  const robot::testing::TwoLinkClosedForm arm;
  // Two ways of computing, with some twenty operations on numbers up to 100.
  EXPECT_LT((facts.gravity_torque - arm.g<double>(facts.q)).norm(), 1e-12);
  EXPECT_LT((facts.inertia - arm.M<double>(facts.q)).norm(), 1e-13);
  EXPECT_NEAR(facts.mass_kg, 11.8 + 1.7 + 5 + 1.2, 1e-14);
  // Ratio of the largest to the smallest root of x^2 - (a + d) x + (a d - b^2).
  const auto& M = facts.inertia;
  const double half = (M(0, 0) + M(1, 1)) / 2;
  const double root = std::sqrt(half * half - M.determinant());
  EXPECT_NEAR(facts.condition_number, (half + root) / (half - root), 1e-11);
}

TEST(RobotFacts, StartAsNearToZeroAsTheRangesAllow) {
  robot::Model model = robot::testing::two_link();
  model.lower[0] = 0.25;
  const RobotFacts facts(model, {});
  EXPECT_EQ(facts.q[0], 0.25);
  EXPECT_EQ(facts.q[1], 0);
}

TEST(RobotFacts, WarnOfPositionsOutsideTheRangeAndRefuseAWrongNumber) {
  EXPECT_THAT(RobotFacts(robot::testing::branching(), {5, 0, 0, 0}).warnings,
              ElementsAre(HasSubstr("position 5 of joint turn is outside its range [-2.5, 2]")));
  EXPECT_THROW(RobotFacts(robot::testing::branching(), {1, 2}), base::Failure);
}

TEST(RobotFacts, AreWrittenForPeopleAndPrograms) {
  const RobotFacts facts(robot::testing::branching(), {});
  EXPECT_THAT(to_text(facts), AllOf(HasSubstr("4 joints, 7 bodies"), HasSubstr("prismatic"),
                                    HasSubstr("continuous"), Not(HasSubstr("inf"))));
  const auto json = to_json(facts);
  std::vector<std::string> keys;
  for (const auto& [key, value] : json.items()) keys.push_back(key);
  EXPECT_THAT(keys, ElementsAre("joints", "bodies", "mass_kg", "position", "inertia_matrix",
                                "gravity_torque", "condition_number", "sources", "warnings"));
  EXPECT_EQ(json["joints"][1]["type"], "prismatic");
  EXPECT_EQ(json["joints"][1]["upper"], 0.4);
  EXPECT_TRUE(json["joints"][1]["effort"].is_null());
  EXPECT_EQ(json["inertia_matrix"].size(), 4u);
}

}  // namespace
}  // namespace tachless::report

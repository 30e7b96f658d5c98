// Terms of friction beyond viscous and Coulomb friction, from logs of a simulated law.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "identify/identify.h"
#include "tests/analysis/identify/hidden_arm.h"

namespace tachless::identify::loop_terms_test {
namespace {

using testing::Contains;
using testing::HasSubstr;

/// Rotors, viscous and Coulomb friction, payload of the two-link arm.
const Eigen::VectorXd truth_of_log = (Eigen::VectorXd(7) << 1, 0.2, 3, 0.9, 6, 2, 0.8).finished();

/// Returns how many of the seven numbers are within their intervals.
int held(const Identified& found, const Eigen::VectorXd& truth) {
  int result = 0;
  for (Eigen::Index i = 0; i < truth.size(); ++i) {
    const Identified::Parameter& each = found.parameters[static_cast<std::size_t>(i)];
    result += std::abs(each.value - truth[i]) <= each.half_width ? 1 : 0;
  }
  return result;
}

/// Returns what 10 s of a run of the arm tell, whose law and scenario know nothing of its friction.
/// @param set the further terms of the arm's friction
template <class Set>
Identified found_in_log(const char* bits, const Set& set) {
  const scenario::Scenario believed = scenario("practical_rigid", bits, 10);
  scenario::Scenario plant = hidden(believed, truth_of_log);
  set(plant.plant.drive);
  return identify({record(believed, plant)}, all, {}, ignore);
}

/// The value is one draw of a 95 % interval; the seven others are nearly that.
TEST(LoopTerms, ARiseIsFoundWithItsValue) {
  const Identified found = found_in_log("18", [](plant::DriveSpec& drive) {
    drive.friction_rise_Nm[0] = 4;
    drive.friction_rise_velocity_rad_per_s[0] = 0.15;
  });
  const std::string said = identify::text(found, "arm");
  const Identified::Parameter* rise = parameter(found, "rise shoulder");
  ASSERT_NE(rise, nullptr) << said;
  EXPECT_NEAR(rise->value, 4, rise->half_width) << said;
  EXPECT_LT(rise->half_width, 0.1 * 4) << said;
  EXPECT_NEAR(rise->entry.velocity, 0.15, 0.05 * 0.15) << said;
  EXPECT_EQ(std::ssize(found.parameters), 8) << "no other term\n" << said;
  EXPECT_GE(held(found, truth_of_log), 6) << said;
  for (const Identified::Check& each : found.checks) EXPECT_FALSE(each.misfit.found) << said;
  EXPECT_THAT(found.overrides, Contains(HasSubstr("plant.drive.friction_rise_Nm=[")));
  EXPECT_THAT(found.overrides, Contains(HasSubstr("controller.friction.rise_velocity=[")));
}

/// The simulated arm carries the unknown payload, so that friction by the load holds beside it.
TEST(LoopTerms, FrictionOfTheLoadIsFoundBesideAnUnknownPayload) {
  const Identified found =
      found_in_log("18", [](plant::DriveSpec& drive) { drive.load_friction[0] = 0.08; });
  const std::string said = identify::text(found, "arm");
  const Identified::Parameter* load = parameter(found, "load friction shoulder");
  ASSERT_NE(load, nullptr) << said;
  EXPECT_NEAR(load->value, 0.08, load->half_width) << said;
  EXPECT_LT(load->half_width, 0.1 * 0.08) << said;
  EXPECT_EQ(std::ssize(found.parameters), 8) << "no other term\n" << said;
  EXPECT_GE(held(found, truth_of_log), 6) << said;
  for (const Identified::Check& each : found.checks) EXPECT_FALSE(each.misfit.found) << said;
  EXPECT_THAT(found.overrides, Contains(HasSubstr("controller.friction.load=[")));
}

TEST(LoopTerms, AreNotFoundOnArmsWithoutThem) {
  std::mt19937 random(5);
  for (const char* const bits : {"14", "16", "20"}) {
    const scenario::Scenario believed = scenario("practical_rigid", bits, 8);
    const Eigen::VectorXd truth = draw_truth(believed, Parameters(believed, all), random);
    const Identified found = identify({record(believed, hidden(believed, truth))}, all, {}, ignore);
    EXPECT_EQ(std::ssize(found.parameters), 7) << identify::text(found, bits);
  }
}

}  // namespace
}  // namespace tachless::identify::loop_terms_test

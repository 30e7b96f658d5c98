#include "certificate/certify.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "tests/certificate/scenarios.h"

namespace tachless::certificate {
namespace {

using namespace testing;
using ::testing::HasSubstr;

/// The figures were computed by an independent program.
TEST(Certify, OfThePapersRigidScenario) {
  const experiment::Scenario scenario = shipped("paper_rigid");
  const Certificate result = certify(scenario, true);
  const auto json = to_json(result);
  EXPECT_NEAR(json["paper"]["eq19"].get<double>(), 7.9205, 1e-3 * 7.9205);
  EXPECT_NEAR(json["paper"]["eq25"].get<double>(), 0.0026513, 1e-3 * 0.0026513);
  EXPECT_NEAR(json["paper"]["c1"].get<double>(), 0.648, 1e-3);
  EXPECT_NEAR(json["region"]["fastest"]["rate_per_s"].get<double>(), 1.36, 0.01);
  EXPECT_GT(json["region"]["largest"]["ball"].get<double>(), 250);
  EXPECT_EQ(json["region"]["status"], "proved");
  EXPECT_TRUE(json["region"]["largest"]["initial_state"]["certified"].get<bool>());
  EXPECT_NEAR(json["sampled"]["limit_s"].get<double>(), 1.0191e-4, 1e-7);
  EXPECT_TRUE(json["sampled"]["stable"].get<bool>());
  EXPECT_NEAR(json["sampled"]["decay_per_s"].get<double>(), 0.68, 0.01);
  const std::string text = page(result, scenario, true);
  EXPECT_THAT(text, HasSubstr("(25) eps > … / beta_3"));
  EXPECT_THAT(text, HasSubstr("Certified region (proved for all postures; continuous time"));
  EXPECT_FALSE(to_json(certify(scenario, false)).contains("paper"));
  const std::string brief = page(certify(scenario, false), scenario, false);
  EXPECT_EQ(std::ranges::count(brief, '\n'), 5) << brief;
  EXPECT_THAT(brief, HasSubstr("proved: this start is in it"));
}

/// Of initial states, V decides.
TEST(Certify, AnInitialStateBeyondTheLevelIsNotCertified) {
  const experiment::Scenario scenario = shipped(
      "practical_rigid",
      {"plant.initial.position_rad=[3, -3]", "plant.initial.velocity_rad_per_s=[2000, 2000]"});
  const Certificate result = certify(scenario, false);
  ASSERT_TRUE(result.stability && result.stability->largest);
  EXPECT_FALSE(result.stability->largest->holds_initial_state());
  EXPECT_GT(result.stability->largest->V0, result.stability->largest->region.level);
  EXPECT_FALSE(to_json(result)["region"]["largest"]["initial_state"]["certified"].get<bool>());
}

TEST(Certify, OfAnotherLawHasTheSampledLoopAlone) {
  const experiment::Scenario scenario =
      shipped("practical_rigid",
              {"controller.law=slotine_li", "controller.gains={lambda: 20, ks: [500, 30]}"});
  const Certificate result = certify(scenario, false);
  EXPECT_FALSE(result.stability);
  EXPECT_THAT(page(result, scenario, true),
              HasSubstr("no stability certificate is available for slotine_li"));
  EXPECT_TRUE(result.loop.stable);
}

TEST(Certify, NamesTheReasonWhereALawCannotBeLinearised) {
  const experiment::Scenario scenario = shipped(
      "practical_rigid", {"controller.law=robust_differentiator",
                          "controller.gains={kp: [40000, 2400], kd: [1000, 60], lipschitz: 4000}"});
  const Certificate result = certify(scenario, false);
  EXPECT_THAT(page(result, scenario, true), HasSubstr("cannot be linearised (the differentiator"));
  EXPECT_THAT(to_json(result)["sampled"]["unknown"].get<std::string>(), HasSubstr("cube root"));
  EXPECT_TRUE(objections(result).empty());
}

}  // namespace
}  // namespace tachless::certificate

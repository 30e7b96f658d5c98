#include "certificate/certify.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/certificate/scenarios.h"

namespace tachless::certificate {
namespace {

using namespace testing;
using ::testing::HasSubstr;

TEST(Certify, OfThePapersRigidScenario) {
  const experiment::Scenario scenario = shipped("paper_rigid");
  const Certificate result = certify(scenario);
  ASSERT_TRUE(result.stability && result.sampled);
  const auto json = to_json(result);
  // The figures were computed by an independent program.
  EXPECT_NEAR(json["printed"]["eq19"].get<double>(), 7.9205, 1e-3 * 7.9205);
  EXPECT_NEAR(json["printed"]["eq25"].get<double>(), 0.0026513, 1e-3 * 0.0026513);
  EXPECT_NEAR(json["printed"]["c1"].get<double>(), 0.648, 1e-3);
  EXPECT_NEAR(json["printed"]["c1_gamma_2_free"].get<double>(), 0.919, 1e-3);
  EXPECT_NEAR(json["completed"]["rho"].get<double>(), 543.6, 1e-3 * 543.6);
  EXPECT_NEAR(json["two_weights"]["fastest"]["rate_per_s"].get<double>(), 1.36, 0.01);
  EXPECT_GT(json["matrix"]["ball"].get<double>(), 250);
  EXPECT_EQ(json["matrix"]["status"], "proved");
  EXPECT_TRUE(json["two_weights"]["initial_state"]["certified"].get<bool>());
  EXPECT_NEAR(json["sampled"]["limits_s"]["zero_order_hold"]["delay_0"].get<double>(), 9.7123e-5,
              1e-8);
  EXPECT_NEAR(json["sampled"]["limits_s"]["tustin"]["delay_1"].get<double>(), 3.4224e-5, 1e-8);
  EXPECT_TRUE(json["sampled"]["stable"].get<bool>());
  EXPECT_NEAR(json["slow_pole_per_s"][0].get<double>(), 0.68, 0.01);
  EXPECT_THAT(page(result, scenario), HasSubstr("(25) eps > … / beta_3"));
}

/// Of initial states, V decides.
TEST(Certify, AnInitialStateBeyondTheLevelIsNotCertified) {
  const experiment::Scenario scenario = shipped(
      "practical_rigid",
      {"plant.initial.position_rad=[3, -3]", "plant.initial.velocity_rad_per_s=[2000, 2000]"});
  const Certificate result = certify(scenario);
  ASSERT_TRUE(result.stability && result.stability->largest);
  EXPECT_FALSE(result.stability->largest->holds_initial_state());
  EXPECT_GT(result.stability->largest->V0, result.stability->largest->region.level);
  EXPECT_FALSE(to_json(result)["two_weights"]["initial_state"]["certified"].get<bool>());
}

TEST(Certify, AnotherLawHasItsSampledLoopAloneAndSaysSo) {
  const experiment::Scenario scenario = shipped(
      "practical_rigid",
      {"controller.law=slotine_li", "controller.gains.lambda=20", "controller.gains.ks=[500, 30]"});
  const Certificate result = certify(scenario);
  EXPECT_FALSE(result.stability);
  EXPECT_THAT(page(result, scenario), HasSubstr("slotine_li has no certificate here"));
  ASSERT_TRUE(result.sampled);
  EXPECT_FALSE(result.sampled->has_filter);
  EXPECT_EQ(result.sampled->limits.size(), 1U);
}

TEST(Certify, SaysWhyALawHasNoSampledCertificate) {
  const experiment::Scenario scenario =
      shipped("practical_rigid",
              {"controller.law=robust_differentiator", "controller.gains.lipschitz=4000"});
  const Certificate result = certify(scenario);
  EXPECT_FALSE(result.sampled);
  EXPECT_THAT(page(result, scenario), HasSubstr("cannot be linearised (the differentiator"));
  const auto json = to_json(result);
  EXPECT_FALSE(json.contains("sampled"));
  EXPECT_THAT(json.at("no_sampled_certificate").get<std::string>(), HasSubstr("cube root"));
}

}  // namespace
}  // namespace tachless::certificate

#include "certify/certify.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "tests/analysis/linear/scenarios.h"

namespace tachless::certify::certify_test {
namespace {

using namespace linear;
using namespace lyapunov;
using namespace linear::testing;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

/// The figures were computed by an independent program.
TEST(Certify, OfThePapersRigidScenario) {
  const scenario::Scenario scenario = linear::testing::shipped("paper_rigid");
  const Certificate result = certify(scenario, {.paper = true});
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
  EXPECT_FALSE(to_json(certify(scenario)).contains("paper"));
  const std::string brief = page(certify(scenario), scenario, false);
  EXPECT_EQ(std::ranges::count(brief, '\n'), 6) << brief;
  EXPECT_THAT(brief, HasSubstr("proved in continuous time: this start is in it"));
  EXPECT_THAT(brief, HasSubstr(" N m (shoulder, no limit), 1 rad/s (elbow, no limit)\n"));
}

constexpr const char* limits = "plant.drive.torque_limit_Nm=[900, 300]";

/// V decides which initial states are certified. Without a bound that holds, none is printed.
TEST(Certify, AnInitialStateBeyondTheLevelIsNotCertified) {
  const scenario::Scenario scenario = linear::testing::shipped(
      "practical_rigid", {"plant.initial.position_rad=[3, -3]",
                          "plant.initial.velocity_rad_per_s=[2000, 2000]", limits});
  const Certificate result = certify(scenario);
  ASSERT_TRUE(result.stability && result.stability->largest);
  EXPECT_FALSE(result.stability->largest->holds_initial_state());
  EXPECT_GT(result.stability->largest->V0, result.stability->largest->region.level);
  const auto region = to_json(result)["region"];
  EXPECT_FALSE(region["largest"]["initial_state"]["certified"].get<bool>());
  EXPECT_FALSE(region["start"]["certified"].get<bool>());
  EXPECT_TRUE(region["start"]["torque_share"].is_null());
  EXPECT_TRUE(region["largest"]["torque_share"].is_null());
  EXPECT_GT(region["largest"]["torque_level"], 0);
  for (const bool full : {false, true}) {
    EXPECT_THAT(page(result, scenario, full), Not(HasSubstr("needs at most")));
  }
  EXPECT_THAT(page(result, scenario, false), HasSubstr("this start is NOT in it"));
}

/// Each choice of the weights has a bound that holds.
TEST(Certify, TheStartHasTheLeastBoundOfTheTorque) {
  const scenario::Scenario scenario = linear::testing::shipped("practical_rigid", {limits});
  const Certificate result = certify(scenario);
  const auto region = to_json(result)["region"];
  const double share = region["start"]["torque_share"];
  EXPECT_EQ(share, std::min(region["fastest"]["torque_share"].get<double>(),
                            region["largest"]["torque_share"].get<double>()));
  for (const bool full : {false, true}) {
    EXPECT_THAT(page(result, scenario, full),
                HasSubstr(fmt::format("needs at most {:.0f} % of a limit", 100 * share)));
  }
  EXPECT_THAT(page(result, scenario, false),
              HasSubstr(" % of the torque limit (shoulder), 1 rad/s (elbow, no limit)\n"));
}

/// The region knows nothing of a payload: what is printed of it says so, in short and in full.
TEST(Certify, SaysWhatTheRegionLeavesOut) {
  const scenario::Scenario scenario =
      linear::testing::shipped("practical_rigid", {"plant.payload.mass_kg=2"});
  const Certificate result = certify(scenario);
  for (const bool full : {false, true}) {
    EXPECT_THAT(page(result, scenario, full), HasSubstr("the payload of 2 kg is not in it"));
  }
}

/// V without cross terms holds every start at a constant reference; the region of a rate does not.
TEST(Certify, AtAConstantReferenceEveryStartIsCertified) {
  const auto start = [](const char* position, const char* says) {
    const scenario::Scenario scenario = linear::testing::shipped(
        "regulation", {position, "plant.drive.torque_limit_Nm=[9000, 3000]"});
    const Certificate result = certify(scenario);
    EXPECT_THAT(page(result, scenario, false), HasSubstr(says));
    return to_json(result)["region"]["start"];
  };
  const auto near = start("plant.initial.position_rad=[0.1, 0]",
                          "proved in continuous time: this start is in it");
  const auto far = start("plant.initial.position_rad=[3, 3]",
                         "proved in continuous time: this start is certified, but without a rate");
  for (const auto& each : {near, far}) {
    EXPECT_TRUE(each["certified"].get<bool>());
    EXPECT_TRUE(each["proved"].get<bool>());
  }
  EXPECT_GT(far["torque_share"].get<double>(), near["torque_share"].get<double>());
}

TEST(Certify, KnowsTheSpeedOfAReferenceThatALongRunMeetsAtRest) {
  // 4000 s / 20000 is a period of the 5 Hz.
  const scenario::Scenario scenario = linear::testing::shipped(
      "practical_rigid",
      {"loop.duration_s=4000", "reference.sinusoid.phase_rad=1.5707963267948966"});
  std::string why_not;
  const auto found = lyapunov::stability_certificate(scenario, linear::Effort::quick, why_not);
  EXPECT_NEAR(found.value().B_d, std::sqrt(2), 1e-6);  // 20001 instants of one period
}

/// Each run of whole periods is sampled over one of them.
TEST(Certify, TheTorqueOfAStartIsThatOfItsReferenceHoweverLongTheRun) {
  const auto share = [](const char* duration) {
    const auto result = certify(linear::testing::shipped("practical_rigid", {limits, duration}));
    return result.stability.value().start.torque_share.value();
  };
  // The same numbers, but for rounding: 63 s / 63 is a multiple of the period.
  EXPECT_NEAR(share("loop.duration_s=63"), share("loop.duration_s=5"), 1e-6);
}

/// One link on a joint of that type, from 2.5 rad or m beside a sinusoid: of a constant inertia, so
/// that the region has no end.
scenario::Scenario one_joint(const std::string& type) {
  return scenario::parse_scenario(
      "name: one\nrobot: {urdf: one.urdf}\n"
      "plant: {drive: {torque_limit_Nm: 30}, initial: {position_rad: 2.5}}\n"
      "reference: {sinusoid: {amplitude_rad: 0.1, frequency_hz: 0.5}}\n"
      "controller: {law: loria_ortega_rigid, gains: {kp: 40, kd: 20, a: 100, b: 100}}\n"
      "loop: {duration_s: 5}\n",
      "<robot name=\"one\"><link name=\"ground\"/>"
      "<link name=\"bob\"><inertial><origin xyz=\"0 0 -1\"/><mass value=\"1\"/>"
      "<inertia ixx=\"1\" iyy=\"1\" izz=\"1\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link>"
      "<joint name=\"swing\" type=\"" +
          type +
          "\"><parent link=\"ground\"/><child link=\"bob\"/><axis xyz=\"0 1 0\"/>"
          "<limit lower=\"-3\" upper=\"3\" effort=\"30\" velocity=\"10\"/></joint></robot>",
      "one.yaml");
}

TEST(Certify, ARegionWithoutEndHasABoundOfTheTorque) {
  const scenario::Scenario scenario = one_joint("revolute");
  const Certificate result = certify(scenario);
  const auto region = to_json(result)["region"];
  ASSERT_TRUE(region["largest"]["level"].is_null());  // infinite
  // kp e alone is 100 N m.
  EXPECT_GT(region["start"]["torque_share"].get<double>(), 100.0 / 30);
  EXPECT_GT(region["largest"]["torque_level"].get<double>(), 0);
  EXPECT_LT(region["largest"]["torque_level"].get<double>(),
            region["largest"]["initial_state"]["V"].get<double>());
  EXPECT_THAT(page(result, scenario, true),
              AllOf(HasSubstr("without saturation from rest "), Not(HasSubstr("nan"))));
}

/// A constant inertia has a region without end, but a slider's range ends it.
TEST(Certify, APrismaticJointsRangeEndsARegionWithoutEnd) {
  const scenario::Scenario scenario = one_joint("prismatic");
  for (const linear::Effort effort : {linear::Effort::quick, linear::Effort::full}) {
    std::string why_not;
    const auto found = lyapunov::stability_certificate(scenario, effort, why_not);
    ASSERT_TRUE(found && found->fastest);
    EXPECT_TRUE(std::isfinite(found->fastest->region.level));
    EXPECT_NEAR(found->fastest->region.e_reached[0], 2.9, 1e-3);
  }
}

/// docs/certificate.md: of paper_rigid no measurement may be missed.
TEST(Certify, SaysWhereNoMissedMeasurementIsFoundStable) {
  const scenario::Scenario scenario = linear::testing::shipped("paper_rigid");
  Certificate all;
  all.loop = analyse(scenario, linear::Effort::full);
  ASSERT_EQ(all.loop.missed.value().measurements, 0);
  EXPECT_THAT(
      page(all, scenario, true),
      HasSubstr("missed measurements                not even single ones were found to be stable"));
}

TEST(Certify, OfAnotherLawHasTheSampledLoopAlone) {
  const scenario::Scenario scenario = linear::testing::shipped(
      "practical_rigid",
      {"controller.law=slotine_li", "controller.gains={lambda: 20, ks: [500, 30]}"});
  const Certificate result = certify(scenario);
  EXPECT_FALSE(result.stability);
  EXPECT_THAT(page(result, scenario, true),
              HasSubstr("no stability certificate is available for slotine_li"));
  EXPECT_TRUE(result.loop.stable);
}

TEST(Certify, NamesTheReasonWhereALawCannotBeLinearised) {
  const scenario::Scenario scenario = linear::testing::shipped(
      "practical_rigid", {"controller.law=robust_differentiator",
                          "controller.gains={kp: [40000, 2400], kd: [1000, 60], lipschitz: 4000}"});
  const Certificate result = certify(scenario);
  EXPECT_THAT(page(result, scenario, true), HasSubstr("cannot be linearised (the differentiator"));
  EXPECT_THAT(to_json(result)["sampled"]["unknown"].get<std::string>(), HasSubstr("cube root"));
  EXPECT_TRUE(objections(result).empty());
}

}  // namespace
}  // namespace tachless::certify::certify_test

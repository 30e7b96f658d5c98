// Identification of a payload's mass, centre and inertia.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/analysis/identify/hidden_arm.h"
#include "tests/analysis/identify/table_of_motion.h"

namespace tachless::identify::load_test {
namespace {

using Eigen::Index;
using testing::Contains;
using testing::HasSubstr;

robot::MassProperties tool() {
  robot::MassProperties body;
  body.mass = 2.5;
  body.p_Bcm << 0.03, -0.02, 0.09;
  body.I_Bcm << 0.02, 0.001, 0, 0.001, 0.018, -0.002, 0, -0.002, 0.009;
  return body;
}

scenario::Scenario iiwa(const std::string& on) {
  scenario::Scenario scenario =
      scenario::load_scenario(TACHLESS_SOURCE_DIR "/scenarios/iiwa_point_to_point.yaml");
  scenario.plant.payload = {.link = on};
  return scenario;
}

double tool_friction(Index /*joint*/, double v, double /*load*/) {
  return 2 * v + (v > 0 ? 1 : -1);
}

void expect_tool(const Load& load) {
  const robot::MassProperties truth = tool();
  EXPECT_NEAR(load.mass, truth.mass, load.mass_half_width);
  EXPECT_LT(load.mass_half_width, 0.02);
  const double inertia[6] = {0.02, 0.001, 0, 0.018, -0.002, 0.009};
  for (Index i = 0; i < 3; ++i) {
    EXPECT_NEAR(load.centre[i], truth.p_Bcm[i], load.centre_half_width[i]);
    EXPECT_LT(load.centre_half_width[i], 2e-3);
  }
  for (Index i = 0; i < 6; ++i) {
    // One of six 95 % intervals may miss by a little.
    EXPECT_NEAR(load.inertia[i], inertia[i], 1.5 * load.inertia_half_width[i]);
  }
}

std::string last_link(const scenario::Scenario& scenario) {
  return scenario.model->bodies.back().link;
}

TEST(Payload, MassCentreAndInertiaAreFoundAgainstTheUrdf) {
  const std::string on = last_link(iiwa(""));
  const scenario::Scenario scenario = iiwa(on);
  Recording table = table_of_motion(scenario, robot::with_payload(*scenario.model, tool(), on), 20,
                                    0, tool_friction);
  add_noise(table, 1e-3);
  const Identified found =
      identify({table}, {Kind::rotor, Kind::viscous, Kind::coulomb, Kind::load}, {}, ignore);
  ASSERT_TRUE(found.load);
  expect_tool(*found.load);
  for (const Identified::Parameter& each : found.parameters) {
    EXPECT_TRUE(each.doubt.empty() || each.in_sum) << each.entry.name << each.doubt;
  }
  EXPECT_TRUE(found.load->inertia_shown);
  EXPECT_THAT(found.overrides, Contains(HasSubstr("plant.payload={mass_kg: 2.")));

  // The fields of controllers are the same body.
  nlohmann::ordered_json json;
  to_json(json, *found.load);
  const auto& kuka = json["kuka"];
  EXPECT_NEAR(kuka["CM_mm"][2].get<double>(), 90, 2);
  const auto angle = [&](int i) { return kuka["CM_ABC_deg"][i].get<double>() * M_PI / 180; };
  const Eigen::Matrix3d R = (Eigen::AngleAxisd(angle(0), Eigen::Vector3d::UnitZ()) *
                             Eigen::AngleAxisd(angle(1), Eigen::Vector3d::UnitY()) *
                             Eigen::AngleAxisd(angle(2), Eigen::Vector3d::UnitX()))
                                .toRotationMatrix();
  Eigen::Vector3d J;
  for (int i = 0; i < 3; ++i) J[i] = kuka["J"][i].get<double>();
  Eigen::Matrix3d I;
  for (int i = 0; i < 9; ++i) I(i % 3, i / 3) = json["franka"]["load_inertia"][i].get<double>();
  EXPECT_LT((R * J.asDiagonal() * R.transpose() - I).norm(), 1e-12);
  EXPECT_NEAR(json["ur"]["inertia"][3].get<double>(), I(0, 1), 1e-15);
}

/// Links that differ from the URDF's would be taken for the payload. A run without it tells them
/// apart.
TEST(Payload, IsToldFromLinksByARunWithoutIt) {
  const std::string on = last_link(iiwa(""));
  const scenario::Scenario scenario = iiwa(on);
  robot::Model arm = *scenario.model;
  for (robot::MassProperties& body : arm.bodies) body.mass *= 1.1;
  Recording with = table_of_motion(scenario, robot::with_payload(arm, tool(), on), 20, 0,
                                   tool_friction),
            without = table_of_motion(scenario, arm, 20, 0.05, tool_friction);
  add_noise(with, 1e-3);
  add_noise(without, 1e-3);
  without.loaded = false;
  const std::vector<Kind> unknown = {Kind::rotor, Kind::viscous, Kind::coulomb, Kind::inertia,
                                     Kind::load};
  const Identified found = identify({with, without}, unknown, {}, ignore);
  ASSERT_TRUE(found.load);
  EXPECT_NEAR(found.load->mass, tool().mass, found.load->mass_half_width);
  EXPECT_LT(found.load->mass_half_width, 0.05);
  // Without that run the payload is a part of its link.
  const Identified alone = identify({with}, unknown, {}, ignore);
  bool in_doubt = false;
  for (const Identified::Parameter& each : alone.parameters) {
    in_doubt = in_doubt || (each.entry.name == "payload mass" && !each.doubt.empty());
  }
  EXPECT_TRUE(in_doubt);
  EXPECT_THAT(alone.advice, Contains(HasSubstr("--without")));
}

/// The arm of two links moves in a plane. The coordinate along its axes has no part in a torque.
TEST(Payload, OfALogTheLoopIsSimulatedWithIt) {
  scenario::Scenario believed = scenario("practical_rigid", "20", 5);
  believed.plant.payload.link = "tip";
  scenario::Scenario plant = believed;
  robot::MassProperties body;
  body.mass = 1;
  body.p_Bcm << 0.05, 0, -0.2;
  plant.model = std::make_shared<robot::Model>(
      robot::with_payload(*believed.model, body, believed.plant.payload.link));
  plant.plant.payload.mass_kg = 0;
  const Identified found = identify({record(believed, plant)}, {Kind::load}, {}, ignore);
  EXPECT_TRUE(found.simulated);
  ASSERT_TRUE(found.load);
  EXPECT_NEAR(found.load->mass, 1, 0.01);
  int shown = 0;
  for (Index i = 0; i < 3; ++i) {
    if (!std::isfinite(found.load->centre_half_width[i])) continue;
    ++shown;
    EXPECT_NEAR(found.load->centre[i], body.p_Bcm[i], 0.01);
  }
  EXPECT_EQ(shown, 2);
  EXPECT_FALSE(found.load->inertia_shown);
  EXPECT_THAT(identify::text(found, "arm"), HasSubstr("is not shown by this motion"));
}

}  // namespace
}  // namespace tachless::identify::load_test

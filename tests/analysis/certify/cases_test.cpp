#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "certify/certify.h"
#include "controller/laws.h"
#include "controller/registry.h"
#include "lyapunov/law_loop.h"
#include "lyapunov/stability_certificate.h"
#include "numerics/golden_section.h"
#include "reference/make_trajectory.h"
#include "tests/analysis/linear/scenarios.h"

namespace tachless::certify::cases_test {
namespace {

using linear::testing::shipped;
using ::testing::HasSubstr;
using ::testing::Not;

scenario::Scenario scenario_of(const std::string& name,
                               const std::vector<std::string>& overrides = {}) {
  return scenario::load_scenario(
      fmt::format("{}/tests/analysis/certify/cases/{}.yaml", TACHLESS_SOURCE_DIR, name), overrides);
}

/// A motion of 0.16 s between two of 25 even instants: V must fall there too. No region does at the
/// bandwidth of the case, 6 rad/s; at 30 rad/s there are two.
class BurstOfScheduledGains : public ::testing::TestWithParam<int> {};

TEST_P(BurstOfScheduledGains, IsInTheRegion) {
  const scenario::Scenario s =
      scenario_of("burst_between_instants", {fmt::format("controller.gains.w={}", GetParam())});
  std::string why_not;
  const auto found = lyapunov::stability_certificate(s, linear::Effort::full, why_not);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->fastest && found->largest, GetParam() == 30);
  const auto law = controller::make_law<controller::law::LoriaOrtegaScheduled>(s);
  const reference::Trajectory trajectory = reference::make_trajectory(s);
  double fastest_s = 0, speed = 0;
  for (int k = 0; k <= 21000; ++k) {
    const double v = trajectory.at(1e-3 * k).v_ref.norm();
    if (v <= speed) continue;
    speed = v;
    fastest_s = 1e-3 * k;
  }
  EXPECT_GT(speed, 20);
  // The bound holds between samples too, by the pieces' jerk.
  const lyapunov::VelocityBound bound = lyapunov::velocity_bound(s);
  EXPECT_GE(bound.speed, speed);
  EXPECT_LT(bound.speed, 1.01 * speed);
  std::vector<lyapunov::ErrorSystem> systems;
  for (int k = -100; k <= 100; k += 4) {
    systems.push_back(lyapunov::system_at(law, trajectory.at(fastest_s + 1e-3 * k),
                                          s.plant.drive.viscous_friction_Nms_per_rad));
  }
  numerics::Postures postures(lyapunov::error_model(s), {24, false, 24, {}, {}});
  constexpr double b_d = 1;
  constexpr bool refine = false;
  const lyapunov::MatrixCondition condition{std::move(systems), std::move(postures), b_d, refine};
  for (const auto& region : {found->fastest, found->largest}) {
    if (!region) continue;
    const auto in_burst = condition.region(region->weights);
    ASSERT_TRUE(in_burst) << "V grows for small errors";
    EXPECT_GT(in_burst->level, 0.99 * region->region.level);
    EXPECT_GT(condition.rate(region->weights, 0), 0.99 * region->rate);
  }
}
INSTANTIATE_TEST_SUITE_P(Bandwidths, BurstOfScheduledGains, ::testing::Values(6, 30));

/// Vdot <= -mu V lacks the integral's part of V: the loop's slowest poles are -5.75 and -5.80 1/s.
TEST(Region, OfALawWithAnIntegralHasNoRate) {
  const scenario::Scenario s =
      shipped("practical_rigid", {"controller.law=loria_ortega_integral",
                                  "controller.gains={kp: [40000, 2400], kd: [1000, 60], a: [1000, "
                                  "1000], b: [1000, 1000], ki: [10000, 600], eps_1: 25, eps_2: "
                                  "0.125}"});
  const Certificate found = certify(s);
  ASSERT_TRUE(found.stability && found.stability->fastest);
  EXPECT_TRUE(to_json(found)["region"]["fastest"]["rate_per_s"].is_null());
  EXPECT_TRUE(to_json(found)["region"]["fastest"]["error_rate_per_s"].is_null());
  EXPECT_THAT(page(found, s, true), HasSubstr("no certified rate"));
}

/// Both sliders end 0.5 m from the middle of a motion of 0.1 m. At 1 kHz the loop is unstable.
TEST(Region, EndsWhereAPrismaticJointsRangeDoes) {
  EXPECT_FALSE(certify(scenario_of("prismatic_region")).stability);
  const scenario::Scenario s = scenario_of("prismatic_region", {"loop.period_s=2e-4"});
  const Certificate found = certify(s);
  ASSERT_TRUE(found.stability);
  ASSERT_TRUE(found.stability->largest);
  for (const auto& region : {found.stability->fastest, found.stability->largest}) {
    if (!region) continue;
    for (int i = 0; i < s.num_joints; ++i) {
      if (s.model->joint_types[static_cast<std::size_t>(i)] == robot::JointType::revolute) continue;
      EXPECT_LT(region->region.e_reached[i], 0.4 + 1e-6) << i;
      EXPECT_LT(region->region.e_at_rest[i], 0.4 + 1e-6) << i;
    }
    EXPECT_TRUE(region->holds_initial_state());
  }
  EXPECT_THAT(page(found, s, false), Not(HasSubstr("range was sampled")));
}

TEST(Region, IsNotPrintedUnderAnUnstableSampledLoop) {
  const scenario::Scenario s = shipped("practical_rigid", {"loop.period_s=8e-3"});
  const Certificate found = certify(s);
  ASSERT_FALSE(found.loop.stable);
  EXPECT_FALSE(found.stability);
  EXPECT_THAT(to_json(found)["region"]["none"].get<std::string>(), HasSubstr("unstable"));
  for (const bool full : {false, true}) {
    EXPECT_THAT(page(found, s, full), HasSubstr("the sampled loop is unstable"));
    EXPECT_THAT(page(found, s, full), Not(HasSubstr("from rest")));
  }
  EXPECT_FALSE(certified_run(s));
  EXPECT_TRUE(certified_run(shipped("practical_rigid")));
}

/// An elbow without limits turns half a turn either way, not 57 rad.
TEST(Region, IsPrintedNoFurtherThanTheJointsRange) {
  const scenario::Scenario s = shipped("practical_rigid");
  const Certificate found = certify(s);
  EXPECT_GT(found.stability->largest->region.e_at_rest[1], 50);
  EXPECT_THAT(page(found, s, false), HasSubstr("from rest anywhere in the joints' range"));
  EXPECT_DOUBLE_EQ(to_json(found)["region"]["largest"]["e_at_rest"][1].get<double>(), M_PI);
}

/// The spectral radius falls along this motion from 1.026 to 0.999.
TEST(Prediction, OfAMotionThatEndsIsAGrowthAndThenADecay) {
  const scenario::Scenario s = scenario_of("unstable_start_stable_end");
  const Prediction found = analyse(s, linear::Effort::quick);
  EXPECT_TRUE(found.stable);
  EXPECT_LT(found.radius, 1);
  EXPECT_GT(found.radius, 0.99);
  EXPECT_GT(found.growth, 1);
  EXPECT_THAT(text(found), HasSubstr("-fold over the motion, then decay"));
  EXPECT_THAT(no_region(found), HasSubstr("grow over the motion"));
  // Cut off before its end the motion is judged by its growth.
  EXPECT_FALSE(analyse(scenario_of("unstable_start_stable_end", {"loop.duration_s=0.6"}),
                       linear::Effort::quick)
                   .stable);
}

/// An integral is unstable at small gains too: drives of 0.6 of their torque make this loop
/// unstable.
TEST(Margins, OfTheGainLookBothWays) {
  const std::vector<std::string> integral = {
      "reference={hold: {position_rad: [0, 0]}}", "controller.law=loria_ortega_integral",
      "controller.gains={kp: [1000, 100], kd: [60, 6], a: 200, b: 200, ki: [1000, 100], eps_1: 6, "
      "eps_2: 0.01}"};
  const Prediction found = analyse(shipped("practical_rigid", integral), linear::Effort::margins);
  ASSERT_TRUE(found.stable && found.margins);
  EXPECT_GT(found.margins->least_gain, 0.6);
  EXPECT_LT(found.margins->least_gain, 0.7);
  EXPECT_THAT(margins_text(*found.margins), HasSubstr(" to 30.1, "));
  const Prediction without = analyse(shipped("practical_rigid"), linear::Effort::margins);
  EXPECT_EQ(without.margins->least_gain, 0);
  EXPECT_THAT(margins_text(*without.margins), Not(HasSubstr(" to ")));
}

TEST(Certify, NamesAllThatIsImpossible) {
  const scenario::Scenario s = shipped("practical_rigid", {"plant.drive.torque_limit_Nm=[1, 0.1]"});
  const Certificate found = certify(s);
  ASSERT_GE(found.feasibility.impossible.size(), 2U);
  for (const std::string& problem : found.feasibility.impossible) {
    EXPECT_THAT(page(found, s, false), HasSubstr(problem));
  }
}

TEST(GoldenSection, FindsAMaximumInsideAndAtAnEnd) {
  EXPECT_NEAR(numerics::largest_between([](double x) { return -(x - 0.3) * (x - 0.3); }, 0, 1), 0.3,
              1e-6);
  EXPECT_NEAR(numerics::largest_between([](double x) { return x; }, 0, 1), 1, 1e-6);
}

}  // namespace
}  // namespace tachless::certify::cases_test

// Gains of the adaptive law: its feedback is that of constant estimates, V falls at every corner of
// the box, and runs adapt.
#include "design/adaptation.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "controller/law/loria_ortega_adaptive.h"
#include "controller/registry.h"
#include "in_process/in_process_loop.h"
#include "lyapunov/weighted_region.h"
#include "robot/dynamics.h"
#include "tests/analysis/linear/scenarios.h"

namespace tachless::design {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

scenario::Scenario with_gains(scenario::Scenario scenario,
                              const std::map<std::string, Vector>& gains) {
  scenario.controller.gains = gains;
  return scenario;
}

/// The largest error of the last second of a run, and the estimates at its end.
struct Followed {
  double error = 0;
  messages::LawSignals last;
};
Followed followed(const scenario::Scenario& scenario) {
  Followed result;
  in_process::run_in_process(scenario, [&](const in_process::TickRecord& record) {
    if (record.time_s >= scenario.loop.duration_s - 1) {
      const Vector e = record.truth.q - record.reference.q_ref;
      result.error = std::max(result.error, e.cwiseAbs().maxCoeff());
    }
    result.last = record.controller;
    return true;
  });
  return result;
}

/// The two-link arm with a load that its law does not know, and a law without gains.
scenario::Scenario loaded(const std::string& gains) {
  return linear::testing::shipped("practical_adaptive",
                                  {"plant.mechanics=native", "controller.gains=" + gains});
}

const std::string any_feedback = "kp: 1, kd: 1, a: 1, b: 1, eps_1: 1, eps_2: 1";

TEST(AdaptiveDesign, HasTheFeedbackOfConstantEstimatesAndACertifiedBox) {
  const scenario::Scenario scenario = loaded("{" + any_feedback + ", mass_max: 1}");
  const Design found = design(scenario, {});
  const scenario::Scenario constant = with_constant_estimates(scenario);
  EXPECT_EQ(constant.controller.law, "loria_ortega_rigid");
  const Design feedback = design(constant, {});
  for (const auto& [name, value] : feedback.gains) EXPECT_EQ(found.gains.at(name), value) << name;
  EXPECT_EQ(found.loop.modes.settling_s, feedback.loop.modes.settling_s);
  EXPECT_THAT(found.warnings, IsEmpty());
  EXPECT_EQ(found.gains.at("mass_max")[0], 1);
  EXPECT_FALSE(found.gains.contains("gamma_moment")) << "nobody asked for it";
  const scenario::Scenario designed = with_gains(scenario, found.gains);
  std::string why_not;
  const auto region = lyapunov::weighted_region(designed, why_not);
  ASSERT_TRUE(region) << why_not;
  EXPECT_GT(region->region.level, 0);
  // It adapts to half a kilogram, of which the feedback alone leaves ten times as much.
  const Followed with = followed(designed);
  EXPECT_NEAR(with.last.value[3][0], 0.5, 0.05);
  EXPECT_LT(with.error, 0.1 * followed(with_gains(constant, feedback.gains)).error);
}

TEST(AdaptiveDesign, TakesRatesOfHalfOfTheStiffness) {
  Design all;
  const Vector one = Vector::Ones(2);
  all.gains = {{"kp", Vector(4000 * one)},
               {"kd", Vector(300 * one)},
               {"a", Vector(300 * one)},
               {"b", Vector(300 * one)}};
  const scenario::Scenario scenario =
      loaded("{" + any_feedback + ", mass_max: 0.5, friction_max: [20, 5]}");
  add_adaptation(scenario, all);
  // The largest speeds of the reference are 2.4 rad/s.
  for (Eigen::Index j = 0; j < 2; ++j) {
    EXPECT_NEAR(all.gains.at("gamma_friction")[j] * 2.4 * 2.4 / 4000, 0.5, 0.01);
  }
  const auto law =
      controller::make_law<controller::law::LoriaOrtegaAdaptive>(with_gains(scenario, all.gains));
  const Vector v = Vector::Zero(2);
  messages::ReferencePoint r{v, v, v, v, v};
  r.q_ref << 0.8, 0.6;
  r.a_ref << -7.2, -9.6;
  const Vector Y = law.columns_at(r, {r.v_ref, r.a_ref}).col(0);
  // Both joints turn at once here, which the motion comes near: the mean of the joints is then 0.5.
  const double mean = all.gains.at("gamma_mass")[0] * Y.squaredNorm() / 4000 / 2;
  EXPECT_LE(mean, 0.55);
  EXPECT_GE(mean, 0.3);
}

TEST(AdaptiveDesign, TakesAMassWithARegionWhereNoneIsGiven) {
  Design all;
  all.gains = {{"kp", Vector{{4000, 400}}},
               {"kd", Vector{{300, 30}}},
               {"a", Vector{{300, 300}}},
               {"b", Vector{{300, 300}}}};
  Design given = all;
  add_adaptation(loaded("{" + any_feedback + "}"), all);
  EXPECT_THAT(all.warnings, IsEmpty());
  EXPECT_GE(all.gains.at("mass_max")[0], 0.5);
  std::string why_not;
  EXPECT_TRUE(
      lyapunov::weighted_region(with_gains(loaded("{" + any_feedback + "}"), all.gains), why_not))
      << why_not;
  add_adaptation(loaded("{" + any_feedback + ", mass_max: 50}"), given);
  ASSERT_EQ(given.warnings.size(), 1U);
  EXPECT_THAT(given.warnings[0], HasSubstr("--set controller.gains.mass_max="));
}

TEST(AdaptiveDesign, FollowsTheInertiaWhereTheScenarioGivesW) {
  const scenario::Scenario scenario = linear::testing::shipped(
      "iiwa_adaptive", {"loop.duration_s=4", "controller.gains.w=1",
                        "controller.gains.gamma_mass=0", "controller.gains.gamma_moment=0"});
  EXPECT_EQ(with_constant_estimates(scenario).controller.law, "loria_ortega_scheduled");
  Design all;
  for (const auto& [name, value] :
       std::map<std::string, double>{{"w", 100}, {"damping", 0.8}, {"a", 1000}, {"b", 1000}}) {
    all.gains[name] = Vector::Constant(7, value);
  }
  add_adaptation(scenario, all);
  EXPECT_GT(all.gains.at("gamma_moment")[0], 0) << "its bound is given";
  const Followed with = followed(with_gains(scenario, all.gains));
  Vector none = Vector::Zero(7);
  for (const char* rate : {"gamma_mass", "gamma_moment"}) all.gains[rate] = none;
  EXPECT_LT(with.error, 0.3 * followed(with_gains(scenario, all.gains)).error);
}

}  // namespace
}  // namespace tachless::design

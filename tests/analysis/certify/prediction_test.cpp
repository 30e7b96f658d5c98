#include "certify/prediction.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "robot/dynamics.h"
#include "tests/analysis/linear/scenarios.h"

namespace tachless::certify::prediction_test {
namespace {

using namespace linear;
using namespace linear::testing;
using ::testing::HasSubstr;
using ::testing::StartsWith;

constexpr const char* shipped_scenarios[] = {
    "flexible_regulation", "iiwa_point_to_point", "paper_flexible",  "paper_rigid",
    "paper_rigid_offset",  "practical_flexible",  "practical_rigid", "regulation"};

/// `run` prints the one, `certify` and `design` the other.
TEST(Prediction, WithLessEffortHasFewerNumbersAndNoOtherOnes) {
  for (const char* name : shipped_scenarios) {
    SCOPED_TRACE(name);
    const scenario::Scenario scenario = linear::testing::shipped(name);
    const Prediction quick = analyse(scenario, linear::Effort::quick);
    const Prediction full = analyse(scenario, linear::Effort::full);
    EXPECT_TRUE(quick.stable);
    EXPECT_EQ(text(quick), text(full));
    EXPECT_EQ(quick.stable, full.stable);
    EXPECT_EQ(quick.radius, full.radius);
    EXPECT_EQ(quick.limit_s, full.limit_s);
    EXPECT_EQ(quick.limit_q, full.limit_q);
    EXPECT_EQ(quick.modes.settling_s, full.modes.settling_s);
    EXPECT_EQ(quick.count_Nm, full.count_Nm);
    ASSERT_TRUE(quick.limit_s);
    EXPECT_GT(*quick.limit_s, quick.settings.period_s);
    EXPECT_FALSE(quick.margins);
    EXPECT_FALSE(analyse(scenario, linear::Effort::margins).missed);
    ASSERT_TRUE(full.margins);
    EXPECT_GT(full.margins->phase_deg, 1);
  }
}

/// The limits are those that an independent program found
/// (tests/analysis/linear/sampled_limit_test.cpp).
TEST(Prediction, LimitIsTheSampledLoops) {
  const struct {
    const char* scenario;
    std::vector<std::string> set;
    double limit_s;
  } rows[] = {{"paper_rigid", {}, 1.0191e-4},
              {"paper_rigid", {"loop.command_delay=1"}, 3.4224e-5},
              {"paper_rigid", {"loop.period_s=1e-3"}, 1.0191e-4},
              {"paper_flexible", {}, 1.7679e-5},
              {"practical_rigid", {"loop.command_delay=0"}, 8.93e-3},
              {"practical_rigid", {}, 3.6e-3}};
  for (const auto& row : rows) {
    const Prediction result =
        analyse(linear::testing::shipped(row.scenario, row.set), linear::Effort::quick);
    ASSERT_TRUE(result.limit_s) << row.scenario;
    EXPECT_NEAR(*result.limit_s, row.limit_s, 0.01 * row.limit_s) << row.scenario;
    EXPECT_EQ(result.stable, result.settings.period_s < row.limit_s) << row.scenario;
  }
}

/// A run is longer than its motion: the postures are the motion's.
TEST(Prediction, DoesNotDependOnHowLongTheRunRestsAfterItsMotion) {
  const auto with = [](const char* duration) {
    return analyse(linear::testing::shipped("iiwa_point_to_point", {duration}),
                   linear::Effort::quick);
  };
  const Prediction once = with("loop.duration_s=4"), longer = with("loop.duration_s=40");
  EXPECT_NEAR(*longer.limit_s, *once.limit_s, 1e-3 * *once.limit_s);
  EXPECT_NEAR(longer.modes.settling_s, once.modes.settling_s, 0.01 * once.modes.settling_s);
}

/// No posture of a motion through waypoints has less than what is printed.
TEST(Prediction, FindsTheWorstPostureBetweenThoseOfTheList) {
  const scenario::Scenario scenario = linear::testing::shipped("ur5e");
  const Prediction found = analyse(scenario, linear::Effort::full);
  const linear::ScenarioLoop loop(scenario);
  constexpr int many = 160;
  double modulus = 1, worst_radius = 0;
  for (int k = 0; k <= many; ++k) {
    const linear::SampledLoop here = loop.at(loop.rest_at(static_cast<double>(k) / many));
    modulus = std::min(modulus, linear::modulus_margin(here, found.settings.period_s));
    worst_radius = std::max(worst_radius, linear::radius_at(here, *found.limit_s));
  }
  EXPECT_LE(found.margins.value().modulus, modulus + 1e-5);
  EXPECT_LE(worst_radius, 1 + 1e-6);
}

/// A lag of 1/(2 pi f) is about as much delay; a fast loop is none.
TEST(Prediction, CountsCurrentLoopsAndNamesWhatItDoesNotCount) {
  const auto margin_s = [](const std::string& hz) {
    return analyse(
               linear::testing::shipped("practical_rigid", {"plant.drive.current_loop_hz=" + hz}),
               linear::Effort::margins)
        .margins.value()
        .delay_s;
  };
  const double ideal_s = margin_s("null");
  EXPECT_NEAR(margin_s("1e5"), ideal_s, 5e-6);
  EXPECT_NEAR(margin_s("200"), ideal_s - 1 / (2 * std::numbers::pi * 200), 1e-4);
  EXPECT_FALSE(
      analyse(linear::testing::shipped("practical_rigid", {"plant.drive.current_loop_hz=5"}),
              linear::Effort::quick)
          .stable);
  EXPECT_EQ(analyse(linear::testing::shipped("practical_rigid"), linear::Effort::quick).not_counted,
            "");
  EXPECT_EQ(
      analyse(linear::testing::shipped("practical_rigid", {"plant.drive.command_age_jitter_ticks=2",
                                                           "plant.drive.torque_offset_Nm=1",
                                                           "plant.encoder.eccentricity_rad=1e-3"}),
              linear::Effort::quick)
          .not_counted,
      "plant.drive.command_age_jitter_ticks, plant.drive.torque_offset_Nm, "
      "plant.encoder.eccentricity_rad");
}

TEST(Prediction, TextHasLimitAndSettlingTime) {
  const std::string line =
      text(analyse(linear::testing::shipped("practical_rigid"), linear::Effort::quick));
  EXPECT_THAT(line, StartsWith("stable at 1 kHz with 1 tick of delay: limit 3."));
  EXPECT_THAT(line, HasSubstr(" ms, settles in 0.1"));
}

/// Not what is small beside the others: 3.7e-6 N m/rad beside 5e7.
TEST(Prediction, RoundingIsPrintedAsZero) {
  const auto of = [](double a, double b) { return list_text(Eigen::Vector2d(a, b)); };
  EXPECT_EQ(of(1.2246e-16, -0.5), "[0, -0.5]");
  EXPECT_EQ(of(3.7e-6, 5e7), "[3.7e-06, 5e+07]");
  EXPECT_EQ(of(2e-5, infinity), "[2e-05, inf]");
  EXPECT_EQ(list_text({}), "[]");
}

TEST(Prediction, APostureThatASearchEndedAtIsZeroWhereItIsBesideZero) {
  EXPECT_EQ(found_posture(Eigen::Vector3d(1.072e-9, -0.5, -9e-7)), Eigen::Vector3d(0, -0.5, 0));
}

TEST(Prediction, RefusalNamesLimitPeriodAndWhatToType) {
  const Prediction result = analyse(
      linear::testing::shipped("paper_rigid", {"loop.command_delay=1"}), linear::Effort::quick);
  EXPECT_FALSE(result.stable);
  const std::string line = refusal(result, "s.yaml");
  EXPECT_THAT(line, StartsWith("s.yaml: unstable at 20 kHz with 1 tick of delay: largest stable "
                               "period 34."));
  EXPECT_THAT(line, HasSubstr("type --set loop.period_s=2e-05 or --force"));
}

/// The loop at rest allows a longer period than the one that is unstable along its motion.
TEST(Prediction, RefusalNamesNoLongerPeriod) {
  Prediction along_the_motion;
  along_the_motion.radius = 1.01;
  along_the_motion.limit_s = 5e-3;
  along_the_motion.settings.period_s = 1e-3;
  EXPECT_THAT(refusal(along_the_motion, "s.yaml"), HasSubstr("type --set loop.period_s=0.0005 or"));
}

/// One joint without gravity, m = 1 kg m²: x' = x + v + u/2, v' = v + u with u = -0.1 x - 0.6 v has
/// the poles' product 0.45 and sum 1.35, inside the unit circle.
TEST(Prediction, APeriodOfASecondMayBeStable) {
  const std::string urdf =
      "<robot name='arm'><link name='base'/><link name='l'><inertial><mass value='1'/><inertia "
      "ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial></link><joint name='j' "
      "type='continuous'><parent link='base'/><child link='l'/><axis xyz='0 0 1'/></joint></robot>";
  const scenario::Scenario scenario = scenario::parse_scenario(
      scenario::urdf_scenario(robot::model_from_urdf(urdf, "arm.urdf"), {"arm", "arm.urdf"}), urdf,
      "arm",
      {"controller.law=wen_bayard", "controller.gains={kp: 0.1, kd: 0.6}", "loop.period_s=1",
       "loop.command_delay=0", "loop.duration_s=10", "reference={hold: {position_rad: 0}}"});
  const Prediction result = analyse(scenario, linear::Effort::quick);
  EXPECT_TRUE(result.stable);
  EXPECT_EQ(limit_text(result.limit_s), "1 s or more");
  EXPECT_EQ(result.unstable_q.size(), 0);
}

TEST(Prediction, TextOfMissedTicksSaysThatTheyAreSearched) {
  EXPECT_EQ(pattern_text(0), "not even single ones were found to be stable (searched, not proved)");
  EXPECT_EQ(pattern_text(3), "any pattern of at most 3 in a row is stable (searched, not proved)");
  EXPECT_EQ(pattern_text(linear::most_missed),
            "any pattern of 1000 in a row is stable (searched, not proved)");
}

TEST(Prediction, UnitsAreAlsoThoseOfJointsThatSlide) {
  const Prediction rotary =
      analyse(linear::testing::shipped("practical_rigid"), linear::Effort::quick);
  EXPECT_EQ(rotary.stiffness_unit, "N m/rad");
  EXPECT_EQ(rotary.torque_unit, "N m");
  const Prediction with_slide = analyse(shipped("panda"), linear::Effort::quick);
  EXPECT_EQ(with_slide.stiffness_unit, "N m/rad (N/m)");
  EXPECT_EQ(with_slide.torque_unit, "N m (N)");
}

/// Friction of one joint displaces the others too.
TEST(Prediction, RestErrorIsThatOfTheWholeMatrixOfGains) {
  const Prediction found =
      analyse(linear::testing::shipped(
                  "practical_rigid",
                  {"controller.law=loria_ortega_matrix",
                   "controller.gains={kp: [[4000, 800], [800, 240]], kd: [[400, 80], [80, 24]], "
                   "a: 400, b: 400}",
                   "plant.drive.coulomb_friction_Nm=[6, 2]"}),
              linear::Effort::quick);
  // K^-1 = [[240, -800], [-800, 4000]] / 320000. K is by differences of step 1e-6.
  EXPECT_NEAR(found.stiffness[1], 240, 1e-3);
  EXPECT_NEAR(found.rest_error[0], (240 * 6 + 800 * 2) / 320000.0, 1e-6);
  EXPECT_NEAR(found.rest_error[1], (800 * 6 + 4000 * 2) / 320000.0, 1e-6);
  EXPECT_THAT(friction_text(found), HasSubstr("F_c/kp = [0.0095, 0.04]"));
}

/// A joint may stop where gravity pulls most, so the bound is that of all postures.
TEST(Prediction, RestErrorHasTheLargestFrictionOfTheLoad) {
  const scenario::Scenario loaded = linear::testing::shipped(
      "practical_rigid", {"plant.drive.coulomb_friction_Nm=[6, 2]",
                          "plant.drive.load_friction=[0.1, 0]", "plant.payload.mass_kg=3"});
  const Vector kp = loaded.controller.gains.at("kp");
  const robot::Model arm = scenario::with_payload(loaded, *loaded.model);
  double most = 0;
  for (int k = 0; k < 400; ++k) {
    most = std::max(
        most, std::abs(robot::gravity_torque(arm, Vector{{k * std::numbers::pi / 200, 0}})[0]));
  }
  const Prediction found = analyse(loaded, linear::Effort::quick);
  // K is by differences of step 1e-6. The bound has the joints' offsets in a straight line.
  EXPECT_GT(found.rest_error[0], (6 + 0.1 * most) / kp[0] * (1 - 1e-6));
  EXPECT_LT(found.rest_error[0], (6 + 0.11 * most) / kp[0]);
  EXPECT_NEAR(found.rest_error[1], 2 / kp[1], 1e-6);
}

/// A run's verdict divides friction by this stiffness.
TEST(Prediction, StiffnessOfAJointWithFrictionIsThatOfItsRestError) {
  const scenario::Scenario scenario = linear::testing::shipped(
      "practical_rigid",
      {"controller.law=loria_ortega_matrix",
       "controller.gains={kp: [[4000, 800], [800, 240]], kd: [[400, 80], [80, 24]], a: 400, "
       "b: 400}",
       "plant.drive.coulomb_friction_Nm=[0, 2]"});
  const Vector found = stiffness(scenario);
  EXPECT_NEAR(found[0], 4000, 1e-2);  // by differences
  EXPECT_NEAR(found[1], 320000.0 / 4000, 1e-3);
}

/// The motors' kp, as large as the drives make it, and the springs in series.
TEST(Prediction, StiffnessOfFlexibleJointsIsThatOfTheLink) {
  const scenario::Scenario scenario =
      linear::testing::shipped("flexible_regulation", {"plant.drive.torque_scale=[0.9, 1.1]"});
  const Prediction found = analyse(scenario, linear::Effort::quick);
  const Vector kp = scenario.controller.gains.at("kp").cwiseProduct(Vector{{0.9, 1.1}});
  const Vector& spring = scenario.robot.flexible->stiffness;
  for (int j = 0; j < 2; ++j) {
    const double series = 1 / (1 / kp[j] + 1 / spring[j]);
    EXPECT_NEAR(found.stiffness[j], series, 1e-6 * series);  // by differences of step 1e-6
  }
}

/// w^2 M(q_ref) and its damping are largest where the arm is stretched out, not at its start.
TEST(Prediction, TorqueOfACountIsTheLargestOverThePostures) {
  const auto at = [](const char* reference) {
    return analyse(linear::testing::shipped(
                       "practical_rigid", {"controller.law=loria_ortega_scheduled",
                                           "controller.gains={w: 20, damping: 0.8, a: 400, b: 400}",
                                           "plant.encoder.resolution_bits=16", "loop.duration_s=3",
                                           "plant.initial={position_rad: [0, 3]}", reference}),
                   linear::Effort::quick)
        .count_Nm.value();
  };
  const Eigen::VectorXd folded = at("reference={hold: {position_rad: [0, 3]}}"),
                        stretched = at("reference={hold: {position_rad: [0, 0]}}"),
                        moving =
                            at("reference={point_to_point: {from_rad: [0, 3], to_rad: [0, 0], "
                               "duration_s: 2}}");
  EXPECT_GT(stretched[0], 1.2 * folded[0]);
  EXPECT_NEAR(moving[0], stretched[0], 1e-6 * stretched[0]);  // by differences of step 1e-6
}

}  // namespace
}  // namespace tachless::certify::prediction_test

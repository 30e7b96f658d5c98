// Identification of one emulated arm whose parameters the law and the recorded scenario do not
// know.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/failure.h"
#include "identify/least_squares.h"
#include "tests/analysis/identify/hidden_arm.h"

namespace tachless::identify {
namespace {

using testing::Contains;
using testing::HasSubstr;
using testing::Not;

/// Parameters of the two-link arm: rotors, viscous and Coulomb friction, payload.
const Eigen::VectorXd truth = (Eigen::VectorXd(7) << 1, 0.2, 5, 1, 6, 1, 0.5).finished();

Recording hidden_run(double seconds) {
  const scenario::Scenario believed = scenario("practical_rigid", "20", seconds);
  return record(believed, hidden(believed, truth));
}

TEST(Identify, LeastSquaresIsAStartAndOutputErrorTheAnswer) {
  const Recording run = hidden_run(3);
  const Parameters parameters(run.scenario, all);
  const Eigen::VectorXd start =
      least_squares({regression(run, parameters)}, parameters, *run.scenario.model).values;
  const Fit fit = output_error({run}, parameters, start, ignore);
  for (Eigen::Index i = 0; i < truth.size(); ++i) {
    const std::string& name = parameters.entries()[static_cast<std::size_t>(i)].name;
    EXPECT_NEAR(start[i], truth[i], 0.02 * truth[i]) << name;
    EXPECT_NEAR(fit.values[i], truth[i], 0.005 * truth[i]) << name;
    EXPECT_LT(fit.half_width[i], 0.01 * truth[i]) << name;
  }
  EXPECT_LT((fit.values - truth).norm(), 0.5 * (start - truth).norm());
  // The residual is the encoder's: a count of 2 pi / 2^20 is 6e-6 rad, and its uniform error 1.7e-6
  // rms.
  EXPECT_LT(fit.residual.maxCoeff(), 4e-6);
}

/// The recorded scenario has one tick of delay. A current loop's lag adds the fraction.
TEST(Identify, FindsTheDelayInTicksAndPartsOfOne) {
  const scenario::Scenario believed = scenario("practical_rigid", "20", 3);
  const std::vector<Kind> unknown = {Kind::rotor, Kind::viscous, Kind::coulomb, Kind::payload,
                                     Kind::delay};
  for (const bool lags : {false, true}) {
    scenario::Scenario plant = hidden(believed, truth);
    plant.loop.command_delay = 3;
    if (lags) plant.plant.drive.current_loop_hz = Eigen::Vector2d(400, 400);
    const Identified found = identify({record(believed, plant)}, unknown, {}, ignore);
    const Identified::Parameter& delay = found.parameters.back();
    EXPECT_EQ(delay.doubt, "");
    const double lag = 1 / (2 * std::numbers::pi * 400 * 1e-3);  // [ticks]
    // A lag is a delay to first order in its product with the frequency, here 0.4 ms at 3 Hz.
    EXPECT_NEAR(delay.value, 3 + (lags ? lag : 0), 0.05);
    EXPECT_LT(delay.half_width, 0.05);
    for (Eigen::Index i = 0; i < truth.size(); ++i) {
      EXPECT_NEAR(found.parameters[static_cast<std::size_t>(i)].value, truth[i], 0.01 * truth[i]);
    }
    EXPECT_THAT(found.overrides, Contains("plant.encoder.latency_ticks=2"));
    EXPECT_THAT(found.overrides, Contains("loop.command_delay=1"));
  }
}

/// One tick and almost one tick agree: no command acts before the end of the first tick in either
/// case.
TEST(Identify, ADelayIsContinuousAtAWholeTick) {
  const Recording run = hidden_run(2);
  const Parameters parameters(run.scenario, {Kind::delay});
  const auto residual = [&](double delay) {
    return simulated_residual(run, parameters, Eigen::VectorXd::Constant(1, delay));
  };
  // The integrator's accuracy is 1e-8.
  EXPECT_LT((residual(1) - residual(1 - 1e-6)).cwiseAbs().maxCoeff(), 1e-7);
}

/// The arm reaches its goal within 0.1 s and rests there, so that one block of 0.2 s has all the
/// motion. The filtered rows leave that interval out. An interval has one degree of freedom then
/// and is wide, but it holds.
TEST(Identify, IntervalsHoldWhereTheMotionIsInTheFirstInstants) {
  const scenario::Scenario scenario =
      scenario::load_scenario(TACHLESS_SOURCE_DIR "/scenarios/regulation.yaml",
                              {"plant.mechanics=native",
                               "plant.drive.viscous_friction_Nms_per_rad=5", "loop.duration_s=8"});
  const Identified found =
      identify({record(scenario, scenario)}, {Kind::rotor, Kind::viscous}, {}, ignore);
  for (const Identified::Parameter& each : found.parameters) {
    if (each.half_width >= std::abs(each.value)) {
      EXPECT_TRUE(each.is_small() || each.doubt.starts_with("its interval reaches zero and is"))
          << each.entry.name;
    }
    if (each.entry.kind != Kind::viscous) continue;
    EXPECT_NEAR(each.value, 5, each.half_width) << each.entry.name;
    EXPECT_GT(each.half_width, 1e-3) << each.entry.name;
  }
}

TEST(Identify, ChecksOnDataThatWereNotUsedAndRefusesAnotherRobot) {
  const Recording run = hidden_run(2), other = hidden_run(2.5);
  const Identified found =
      identify({run}, {Kind::viscous, Kind::coulomb, Kind::payload, Kind::rotor}, {other}, ignore);
  EXPECT_TRUE(found.validated);
  for (const Identified::Check& each : found.checks) {
    EXPECT_LT(each.after, 0.02) << each.joint;
    EXPECT_GT(each.before, 2 * each.after) << each.joint;
  }
  Recording strange = other;
  strange.scenario.robot.gravity_m_per_s2 = 1.6;
  EXPECT_THROW(identify({run, strange}, all, {}, ignore), base::Failure);
}

/// A log has no offset.
TEST(Identify, RefusesToIdentifyNothing) {
  const Recording run = hidden_run(2);
  try {
    identify({run}, {Kind::offset}, {}, ignore);
    ADD_FAILURE();
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
    EXPECT_THAT(failure.what(), HasSubstr("a run: nothing is left to identify"));
  }
}

/// The simulation treats static friction as Coulomb friction, so that is written.
TEST(Identify, WritesTheStaticFrictionThatItTookForCoulombs) {
  scenario::Scenario believed = scenario("practical_rigid", "20", 2);
  const Parameters parameters(believed, {Kind::coulomb});
  const Eigen::Vector2d found(5, 0.5);
  const auto is_static = testing::StartsWith("plant.drive.static_friction_Nm");
  EXPECT_THAT(parameters.overrides(believed, found), Not(Contains(is_static)));
  believed.plant.drive.static_friction_Nm = Eigen::Vector2d(1, 1);
  EXPECT_THAT(parameters.overrides(believed, found),
              Contains("plant.drive.static_friction_Nm=[5, 0.5]"));
  EXPECT_THAT(Parameters(believed, {Kind::viscous}).overrides(believed, found),
              Not(Contains(is_static)));
}

}  // namespace
}  // namespace tachless::identify

#include "design/design_problem.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <new>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "base/failure.h"
#include "design/gain_point.h"
#include "scenario/gains.h"
#include "tests/analysis/linear/answers.h"
#include "tests/analysis/linear/scenarios.h"
#include "tests/core/robot/robots.h"

namespace tachless::design {
namespace {

using namespace certify;
using namespace linear;
using namespace linear::testing;
using Eigen::VectorXd;
using ::testing::Contains;
using ::testing::HasSubstr;

/// Returns the scenario that `design` makes of a bare URDF.
scenario::Scenario bare(const std::string& urdf, const std::string& law) {
  const robot::Model model = robot::model_from_urdf(urdf, "robot.urdf");
  scenario::Scenario scenario = scenario::parse_scenario(
      scenario::urdf_scenario(model, {"bare", "robot.urdf"}), urdf, "bare");
  scenario.controller.law = law;
  return scenario;
}

/// Returns the scenario of a law that is sampled by its answers.
scenario::Scenario asked(const std::vector<std::string>& overrides) {
  scenario::Scenario scenario = linear::testing::shipped("practical_rigid", overrides);
  scenario.controller.measurement = controller::law_facts(scenario.controller.law).measurement;
  return scenario;
}

/// Guards against reading a member before its initialisation: one run in three of the same input
/// designed other gains.
TEST(DesignProblem, DoesNotDependOnWhatWasInItsMemory) {
  const scenario::Scenario scenario = linear::testing::shipped("practical_rigid");
  const auto feedback = [&](std::uint64_t step) {
    alignas(DesignProblem) std::array<std::uint64_t, sizeof(DesignProblem) / 8 + 1> memory{};
    for (std::size_t i = 0; i < memory.size(); ++i) memory[i] = i * step;
    const std::unique_ptr<DesignProblem, decltype(&std::destroy_at<DesignProblem>)> problem(
        new (memory.data()) DesignProblem(scenario, {}), &std::destroy_at<DesignProblem>);
    return Eigen::MatrixXd(
        problem->loop().at(rest_in_range(problem->model(), 1)).law(scenario.loop.period_s).D);
  };
  EXPECT_EQ(feedback(0), feedback(256));  // both read as false flags, but as different pointers
}

/// Kp = w² M + w D contains the friction D once.
TEST(DesignProblem, RuleOfAMatrixHasFrictionOnce) {
  const auto kp = [](const std::string& friction, double w) {
    const scenario::Scenario scenario = linear::testing::shipped(
        "practical_rigid", {"controller.law=loria_ortega_matrix", "controller.gains={}",
                            "plant.drive.viscous_friction_Nms_per_rad=" + friction});
    return VectorXd(DesignProblem(scenario, {}).by_rule(w, 10).at("kp"));
  };
  const VectorXd more = kp("[30, 5]", 20) - kp("[0, 0]", 20);
  // Rounding errors of numbers of about 4000.
  EXPECT_LT((more - Eigen::Vector4d(20 * 30, 0, 0, 20 * 5)).norm(), 1e-9);
}

/// Gains for half the bandwidth: a quarter of kp, half of kd, the same filters.
TEST(DesignProblem, SofterGainsHaveHalfTheBandwidth) {
  const scenario::Scenario scenario = linear::testing::shipped("practical_rigid");
  DesignProblem problem(scenario, {});
  problem.choose_variables();
  const Gains gains = problem.by_rule(20, 10);
  const auto theta = problem.softer(problem.theta_of(gains));
  ASSERT_TRUE(theta);
  const Gains softer = problem.gains(*theta);
  // Rounding errors of logarithms.
  EXPECT_TRUE(softer.at("kp").isApprox(gains.at("kp") / 4, 1e-12));
  EXPECT_TRUE(softer.at("kd").isApprox(gains.at("kd") / 2, 1e-12));
  EXPECT_TRUE(softer.at("a").isApprox(gains.at("a"), 1e-12));
}

/// A gain cannot hold 9 x 9 numbers, so the matrix stays diagonal, with the friction.
TEST(DesignProblem, RuleOfAMatrixIsDiagonalForNineJoints) {
  scenario::Scenario scenario = bare(robot::testing::chain_urdf(9), "loria_ortega_matrix");
  scenario.plant.drive.viscous_friction_Nms_per_rad.setConstant(3);
  const DesignProblem problem(scenario, {});
  const Gains gains = problem.by_rule(20, 10);
  ASSERT_EQ(gains.at("kp").size(), 9);
  EXPECT_EQ(gains.at("kp"), Vector(400 * problem.mean_inertia().array() + 20 * 3));
  EXPECT_EQ(gains.at("kd").size(), 9);
}

TEST(DesignProblem, RefusesAStiffnessOfALawWithoutKp) {
  const scenario::Scenario scenario = bare(robot::testing::chain_urdf(1), "slotine_li");
  DesignProblem free(scenario, {});
  free.choose_variables();
  EXPECT_EQ(free.name_of(0), "lambda of joint 1 (j1)");
  DesignGoal stiff;
  stiff.least_kp = Vector::Constant(1, 100);
  DesignProblem problem(scenario, stiff);
  try {
    problem.choose_variables();
    FAIL() << "100 N m/rad would bound lambda";
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
    EXPECT_THAT(failure.what(), HasSubstr("slotine_li has none: take loria_ortega_rigid"));
  }
}

TEST(DesignProblem, RefusesGoalsWithoutTheKeyThatTheyAreAbout) {
  const auto why = [](const DesignGoal& goal, const std::vector<std::string>& overrides) {
    const scenario::Scenario scenario = linear::testing::shipped("regulation", overrides);
    DesignProblem problem(scenario, goal);
    try {
      problem.choose_variables();
    } catch (const base::Failure& failure) {
      EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
      return std::string(failure.what());
    }
    return std::string();
  };
  const std::string limit = "plant.drive.torque_limit_Nm=[900, 300]",
                    bits = "plant.encoder.resolution_bits=20",
                    no_limit = "plant.drive.torque_limit_Nm=null",
                    no_bits = "plant.encoder.resolution_bits=null";
  DesignGoal start, share, noise;
  start.start_error = 0.1;
  share.count_share = 0.02;
  noise.count_Nm = 1;
  EXPECT_EQ(why(start, {no_limit, bits}),
            "--start-error needs plant.drive.torque_limit_Nm, which the scenario lacks");
  EXPECT_EQ(why(share, {no_limit, bits}),
            "--count-share needs plant.drive.torque_limit_Nm, which the scenario lacks");
  EXPECT_EQ(why(share, {limit, no_bits}),
            "--count-share needs plant.encoder.resolution_bits, which the scenario lacks");
  EXPECT_EQ(why(noise, {limit, no_bits}),
            "--noise needs plant.encoder.resolution_bits, which the scenario lacks");
  for (const DesignGoal& goal : {start, share, noise}) EXPECT_EQ(why(goal, {limit, bits}), "");
  EXPECT_EQ(why({}, {no_limit, no_bits}), "");
}

/// The law is a program without memory. Its first joint has a gain of 0.
TEST(DesignProblem, OfAnAskedLawBeginsAtTheScenariosGainsAndHasNoPoleToBoundThem) {
  scenario::Scenario scenario = linear::testing::shipped("practical_rigid");
  scenario.controller.measurement = "POSITION";
  scenario.controller.gains = {{"kp", Eigen::Vector2d(0, 50)}};
  const auto answers = [](double, controller::Gravity,
                          std::span<const messages::AnyMeasurement> measured,
                          const messages::ReferencePoint& reference) {
    std::vector<Vector> torques;
    for (const messages::AnyMeasurement& each : measured) {
      const Vector& q = std::get<messages::PositionMeasurement>(each).q;
      const Gains gains = scenario::read_gains(reference.gains, 2).value();
      torques.push_back(gains.at("kp").cwiseProduct(reference.q_ref - q));
    }
    return torques;
  };
  DesignProblem problem(scenario, {}, answers);
  problem.choose_variables();
  const auto own = problem.own_theta();
  ASSERT_TRUE(own);
  EXPECT_EQ(*own, VectorXd(VectorXd::Zero(1)));
  EXPECT_EQ(problem.gains(*own), scenario.controller.gains);
  EXPECT_EQ(problem.at({}).upper, VectorXd(VectorXd::Constant(1, std::log(100))));
}

/// Numbers that vary are written with four digits. Matrices do not vary.
TEST(DesignProblem, LeavesMatricesOfAnAskedLawAsTheyAre) {
  const scenario::Scenario scenario =
      asked({"controller.law=loria_ortega_matrix",
             "controller.gains={kp: [[40000.125, 1], [1, 2400]], kd: [[1000, 0], [0, 60]], "
             "a: 1000.125, b: 1000}"});
  DesignProblem problem(scenario, {}, linear::answers_of(scenario));
  problem.choose_variables();
  Design design;
  design.gains = problem.rounded(problem.gains(*problem.own_theta()));
  EXPECT_EQ(design.gains.at("kp"), scenario.controller.gains.at("kp"));
  EXPECT_EQ(design.gains.at("a")[0], 1000);
  EXPECT_THAT(overrides_of(design), Contains("controller.gains.kp=[[40000.125, 1], [1, 2400]]"));
}

/// The errors grow, so there is no settling time to shorten.
TEST(GainSearch, DoesNotBeginAtUnstableGains) {
  const scenario::Scenario scenario = linear::testing::shipped("practical_rigid");
  DesignProblem law(scenario, {});
  law.choose_variables();
  GainProblem problem = law.at(law.first_rests());
  const VectorXd theta = law.theta_of(law.by_rule(2000, 10));
  ASSERT_EQ(judged(problem, theta).modulus, 0);
  int told = 0;
  const FoundGains found = faster_gains(
      problem, theta, 20, [](GainProblem&, const VectorXd&) { return false; },
      [&](int, const FoundGains&) { ++told; });
  EXPECT_EQ(found.settling_s, infinity);
  EXPECT_EQ(found.theta, theta);
  EXPECT_EQ(told, 0);
}

/// The problem of practical_rigid at the postures of its motion, with gains by the rule of thumb.
class RuledGains : public ::testing::Test {
 protected:
  RuledGains() {
    law.choose_variables();
    theta = law.theta_of(law.by_rule(20, 10));
  }

  const scenario::Scenario scenario = linear::testing::shipped("practical_rigid");
  DesignProblem law{scenario, {}};
  VectorXd theta;
};

TEST_F(RuledGains, AreJudgedAsThePredictionJudgesThem) {
  const GainProblem problem = law.at(law.first_rests());
  const scenario::Scenario with = law.with(law.gains(theta));
  const ScenarioLoop loop(with);
  double settling_s = 0, modulus = infinity;
  for (std::size_t i = 0; i < law.first_rests().size(); ++i) {
    const SampledLoop at = loop.at(law.first_rests()[i]);
    modulus = std::min(modulus, modulus_margin(at, with.loop.period_s));
    if (i >= problem.settling.size()) continue;
    settling_s = std::max(settling_s, modes(at, with.loop.period_s).settling_s);
  }
  const FoundGains found = judged(problem, theta);
  // Instants are at most 1 % of the settling time apart (num_instants_judged).
  EXPECT_NEAR(found.settling_s, settling_s, 0.01 * settling_s);
  // A grid of frequencies has no value below the refined least one. The minimum is flat.
  EXPECT_GE(found.modulus, modulus * (1 - 1e-6));
  EXPECT_LE(found.modulus, modulus * 1.02);
}

/// With all gains at a bound, a bound is worth the slope of the largest error.
TEST_F(RuledGains, BindingsAreTheSlopesOfTheErrorAtABound) {
  GainProblem problem = law.at(law.first_rests());
  problem.lower = problem.upper = theta;
  const FoundGains found = judged(problem, theta);
  ASSERT_GT(found.modulus, problem.margin + 0.01);  // the margin does not bind
  const std::vector<Binding> all = bindings(problem, found);
  const auto error = [&](const VectorXd& at) {
    return GainPoint(problem, at).log_errors(found.settling_s).maxCoeff();
  };
  constexpr double step = 1e-4;
  std::size_t seen = 0;
  for (Eigen::Index i = 0; i < theta.size(); ++i) {
    VectorXd moved = theta;
    moved[i] += step;
    const double slope = std::abs(error(moved) - error(theta)) / step;
    const double share = slope * std::log(1.1) / std::log(100);
    const auto binding = std::ranges::find(all, static_cast<std::size_t>(i), &Binding::which);
    if (share < 1.01e-3) continue;  // too little to be told
    ASSERT_NE(binding, all.end()) << i;
    EXPECT_EQ(binding->kind, Binding::Kind::bound);
    EXPECT_NEAR(binding->settling_share, share, 0.01 * share) << i;  // forward differences
    ++seen;
  }
  EXPECT_EQ(seen, all.size());
  EXPECT_GT(seen, 0U);
  EXPECT_TRUE(std::ranges::is_sorted(all, std::greater(), &Binding::settling_share));
}

TEST_F(RuledGains, AreMadeFasterUntilTheMarginBinds) {
  GainProblem problem = law.at(law.first_rests());
  // The fastest gains have a margin of 0.52, and nothing binds there.
  problem.margin = 0.6;
  problem.most_gain.setConstant(infinity);
  const FoundGains found = faster_gains(
      problem, theta, 40, [](GainProblem&, const VectorXd&) { return false; },
      [](int, const FoundGains&) {});
  EXPECT_LT(found.settling_s, judged(problem, theta).settling_s);
  EXPECT_GE(found.modulus, problem.margin);
  const std::vector<Binding> all = bindings(problem, found);
  EXPECT_TRUE(std::ranges::any_of(
      all, [](const Binding& each) { return each.kind == Binding::Kind::margin; }));
}

}  // namespace
}  // namespace tachless::design

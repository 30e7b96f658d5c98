#include "linear/scenario_loop.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Core>

#include "certify/prediction.h"
#include "controller/registry.h"
#include "numerics/decompositions.h"
#include "robot/dynamics.h"
#include "tests/analysis/linear/linear_laws.h"
#include "tests/analysis/linear/loops.h"
#include "tests/analysis/linear/scenarios.h"
#include "tests/support/law_examples.h"

namespace tachless::linear {
namespace {

using namespace linear::testing;
using controller::law::Discretisation;

/// Differences of the law itself against the law written out in linear_loop.h.
TEST(ScenarioLoop, IsTheRigidLawWrittenOut) {
  const ScenarioLoop loop(shipped("practical_rigid"));
  const robot::Model model = robot::testing::two_link();
  const Vector q = both(0);
  const Eigen::MatrixXd gradient = gradient_by_q(model, constant_reference(q));
  for (const double h : {1e-4, 1e-3, 3e-3}) {
    const SampledLoop own{
        rigid_plant(model, constant_reference(q)),
        [&](double period_s) {
          return linear_rigid_law(practical_rigid(), gradient, {Discretisation::tustin, period_s});
        },
        1};
    // Central differences: gains of 1e6 with an error of 1e-10 of them.
    EXPECT_NEAR(radius_at(loop.at(constant_reference(q)), h), radius_at(own, h), 1e-7) << h;
  }
}

TEST(ScenarioLoop, IsTheFlexibleLawWrittenOut) {
  const ScenarioLoop loop(shipped("practical_flexible"));
  const robot::Model model = robot::testing::two_link();
  const Vector q = both(0.3, -0.4);
  for (const double h : {1e-4, 1e-3, 3e-3}) {
    const SampledLoop own{flexible_plant(model, constant_reference(q), stiffness(), rotors()),
                          [&](double period_s) {
                            return linear_flexible_law(model, q, stiffness(), rotors(),
                                                       practical_link(), practical_motor(),
                                                       {Discretisation::tustin, period_s});
                          },
                          0};
    EXPECT_NEAR(radius_at(loop.at(constant_reference(q)), h), radius_at(own, h), 1e-6) << h;
  }
}

/// The margin's factor is on kp and kd: what compensates gravity is known by its model.
TEST(ScenarioLoop, GainMarginIsThatOfKpAndKd) {
  const double h = 1e-3;
  // Soft beside gravity's gradient of 81 N m/rad: a factor of 1.2 on all torques would do harm.
  const auto loop_of = [&](double factor) {
    const auto gains = [&](double joint_1, double joint_2) {
      return fmt::format("=[{:.17g}, {:.17g}]", factor * joint_1, factor * joint_2);
    };
    return ScenarioLoop(
        shipped("regulation", {"loop.command_delay=1", "controller.gains.kp" + gains(10, 2),
                               "controller.gains.kd" + gains(300, 20)}));
  };
  const auto at = [](const ScenarioLoop& loop) {
    return loop.at(constant_reference(both(0.1, 0.3)));
  };
  const ScenarioLoop loop = loop_of(1);
  const robot::Model model = robot::testing::two_link();
  const Eigen::MatrixXd gravity = gradient_by_q(model, constant_reference(both(0.1, 0.3)));
  // Central differences of torques of 1e5 N m/rad times a step of 1e-6: 1e-10 of 1e5.
  EXPECT_LT((at(loop).law(h).compensation - gravity).cwiseAbs().maxCoeff(), 1e-4);
  const double margin = margins(at(loop), h).gain;
  EXPECT_LT(radius_at(at(loop_of(0.999 * margin)), h), 1);
  EXPECT_GT(radius_at(at(loop_of(1.001 * margin)), h), 1);
  // A law that compensates gravity at the reference has no such part.
  const ScenarioLoop at_reference(shipped("flexible_regulation"));
  EXPECT_LT(
      at_reference.at(at_reference.rest_points(1)[0]).law(h).compensation.cwiseAbs().maxCoeff(),
      1e-4);
}

TEST(ScenarioLoop, LinearisesEveryLawButThoseThatSayWhyNot) {
  std::vector<std::string_view> linear;
  for (const support::LawExample& example : support::law_examples()) {
    if (!controller::law_facts(example.law).no_linearisation.empty()) continue;
    const ScenarioLoop loop(shipped(example.scenario, example.overrides()));
    linear.push_back(example.law);
    const double at_one_kilohertz = radius_at(loop.at(loop.rest_points(1)[0]), 1e-3);
    EXPECT_LT(at_one_kilohertz, 1) << example.law;
    EXPECT_GT(at_one_kilohertz, 0.9) << example.law;
    EXPECT_GT(radius_at(loop.at(loop.rest_points(1)[0]), 0.2), 1) << example.law;
  }
  linear.push_back("loria_ortega_adaptive");
  linear.push_back("robust_differentiator");
  EXPECT_THAT(linear, ::testing::UnorderedElementsAreArray(controller::law_names()));
}

/// Round the loop it is the same whether the measurement or the torque is late, and laws with a
/// model of the delay are told the sum of both.
TEST(ScenarioLoop, CountsAnEncodersLatencyOnce) {
  for (const support::LawExample& example : support::law_examples()) {
    if (!controller::law_facts(example.law).no_linearisation.empty()) continue;
    const auto radius = [&](int delay, int latency) {
      std::vector<std::string> overrides = example.overrides();
      overrides.push_back(fmt::format("loop.command_delay={}", delay));
      overrides.push_back(fmt::format("plant.encoder.latency_ticks={}", latency));
      const ScenarioLoop loop(shipped(example.scenario, overrides));
      return radius_at(loop.at(loop.rest_points(1)[0]), 1e-3);
    };
    EXPECT_EQ(radius(1, 2), radius(3, 0)) << example.law;
  }
}

TEST(ScenarioLoop, LinearisesAKalmanFilterOfEitherOrder) {
  for (const char* gains : {"controller.gains={kp: [40000, 2400], kd: [1000, 60], order: 2, "
                            "process_noise: 1.0e+4}",
                            "controller.gains={kp: [40000, 2400], kd: [1000, 60], order: 3, "
                            "process_noise: 1.0e+8}"}) {
    const ScenarioLoop loop(shipped("practical_rigid", {"controller.law=kalman_velocity", gains}));
    EXPECT_LT(radius_at(loop.at(loop.rest_points(1)[0]), 1e-3), 1) << gains;
  }
}

/// With m = 1 and the arm's inertia at rest as that of two single joints the limit is 2 / kv; the
/// coupled arm has it for the largest eigenvalue kv of M^-1 Kd.
TEST(ScenarioLoop, HasTheLimitOfADifferenceOverOnePeriod) {
  const ScenarioLoop loop(
      shipped("practical_rigid", {"controller.law=numerical_difference", "loop.command_delay=0",
                                  "controller.gains={samples: 1, kp: 1e-3, kd: [100, 60]}"}));
  const Vector q = both(1e-9);  // gravity's gradient there is small beside kd / h
  const Eigen::MatrixXd M = robot::mass_matrix(robot::testing::two_link(), q);
  const Eigen::MatrixXd kv = numerics::inverse(M) * Eigen::Vector2d(100, 60).asDiagonal();
  const double limit = 2 / numerics::eigenvalues(kv).real().maxCoeff();
  EXPECT_LT(radius_at(loop.at(constant_reference(q)), 0.97 * limit), 1.001);
  EXPECT_GT(radius_at(loop.at(constant_reference(q)), 1.03 * limit), 1.01);
}

TEST(ScenarioLoop, SaysWhyALawCannotBeLinearised) {
  const scenario::Scenario scenario = shipped(
      "practical_rigid", {"controller.law=robust_differentiator",
                          "controller.gains={kp: [40000, 2400], kd: [1000, 60], lipschitz: 4000}"});
  EXPECT_THAT(certify::text(certify::analyse(scenario, linear::Effort::quick)),
              ::testing::AllOf(::testing::HasSubstr("cannot be linearised (the differentiator"),
                               ::testing::HasSubstr("cube root"),
                               ::testing::HasSubstr("not known before the run")));
}

TEST(ScenarioLoop, KnowsWhetherAndHowLongTheReferenceMoves) {
  EXPECT_DOUBLE_EQ(ScenarioLoop(shipped("paper_rigid")).motion().end_s, 0.2);  // of 5 Hz
  EXPECT_TRUE(ScenarioLoop(shipped("paper_rigid")).motion().repeats);
  EXPECT_TRUE(ScenarioLoop(shipped("paper_rigid")).moves());
  const ScenarioLoop held(shipped("regulation"));
  EXPECT_FALSE(held.moves());
  EXPECT_EQ(held.rest_points(9).size(), 1U);
  const ScenarioLoop points(shipped("iiwa_point_to_point"));
  // It starts at 0.2 s and takes 3 s, and the run is of 4 s.
  EXPECT_DOUBLE_EQ(points.motion().begin_s, 0.2);
  EXPECT_DOUBLE_EQ(points.motion().end_s, 3.2);
  EXPECT_FALSE(points.motion().repeats);
  EXPECT_DOUBLE_EQ(points.rest_points(5).back().q_ref[0], 0.6);
}

TEST(ScenarioLoop, IsOfTheSamePosturesHoweverLongTheRun) {
  const auto points = [](const char* duration) {
    return ScenarioLoop(shipped("iiwa_point_to_point", {duration})).rest_points(5);
  };
  const auto of_short = points("loop.duration_s=4"), of_long = points("loop.duration_s=3600");
  for (std::size_t k = 0; k < of_short.size(); ++k) {
    EXPECT_EQ(of_long[k].q_ref, of_short[k].q_ref) << k;
  }
}

}  // namespace
}  // namespace tachless::linear

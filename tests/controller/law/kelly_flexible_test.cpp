#include "controller/law/rivals/kelly_flexible.h"

#include <gtest/gtest.h>

#include "tests/controller/law/closed_loop.h"

namespace tachless::controller::law::kelly_flexible_test {
namespace {

KellyFlexible law_at(double h) {
  return {{two_link_model(), stiffness, rotor_inertia},
          {vector(300, 400), vector(40, 9), vector(60, 60), vector(50, 70)},
          {h, Discretisation::tustin}};
}

messages::ReferencePoint goal_at(const Vector& q_ref) {
  const Vector zero = Vector::Zero(q_ref.size());
  return {q_ref, zero, zero, zero, zero};
}

TEST(KellyFlexible, BalancesGravityAtItsGoal) {
  // theta = q_ref + K^-1 g(q_ref): the springs carry the links, and the motors get g.
  const TwoLink<double> arm;
  const KellyFlexible law = law_at(1e-3);
  Random random(1);
  for (int i = 0; i < 100; ++i) {
    const messages::ReferencePoint goal = goal_at(random.pair(3));
    const Pair g = arm.g(goal.q_ref);
    const messages::MotorPositionMeasurement measured{goal.q_ref + g.cwiseQuotient(stiffness)};
    const auto step = law.step(law.start(measured, goal), measured, goal);
    EXPECT_LE((step.command.tau - g).norm(), 1e-11);  // Kp times one rounding of theta
    EXPECT_LE(step.signals.value[0].norm(), 1e-14);
  }
}

TEST(KellyFlexible, IsItsFormulaAwayFromTheGoal) {
  const TwoLink<double> arm;
  const double h = 1e-3;
  const KellyFlexible law = law_at(h);
  Random random(2);
  for (int i = 0; i < 100; ++i) {
    const messages::ReferencePoint goal = goal_at(random.pair(3));
    const messages::MotorPositionMeasurement measured{random.pair(3)};
    const KellyFlexible::Memory memory{random.pair(2), random.pair(2)};
    const auto step = law.step(memory, measured, goal);
    const Pair g = arm.g(goal.q_ref);
    const Pair e = measured.theta - goal.q_ref - g.cwiseQuotient(stiffness);
    const double kp[2] = {300, 400}, kd[2] = {40, 9}, a[2] = {60, 60}, b[2] = {50, 70};
    for (int j = 0; j < 2; ++j) {
      const double nu = ((2 - a[j] * h) * memory.nu[j] + 2 * b[j] * (e[j] - memory.e_previous[j])) /
                        (2 + a[j] * h);
      // 20 eps of terms of up to 2e4 N m
      EXPECT_NEAR(step.command.tau[j], g[j] - kp[j] * e[j] - kd[j] * nu, 1e-10);
    }
  }
}

TEST(KellyFlexible, ConvergesAndApproachesItsContinuousLoopAtFirstOrder) {
  const Sine goal{{0, 0}};
  const auto rate = [](double /*t*/, const State<10>& x) {
    const Pair theta = x.segment<2>(2), thetadot = x.segment<2>(6), nu = x.tail<2>();
    const Pair tau = -Pair(300, 400).cwiseProduct(theta) - Pair(40, 9).cwiseProduct(nu);
    State<10> dot;
    dot << FlexibleArm{}(x.head<8>(), tau),
        Pair(50, 70).cwiseProduct(thetadot) - Pair(60, 60).cwiseProduct(nu);
    return dot;
  };
  State<10> beside;
  beside << 0.3, -0.3, 0.3, -0.3, 0, 0, 0, 0, 0, 0;
  const auto settled = solution(rate, beside, 1e-3, 20'000, 2.5e-4);
  EXPECT_LT(final_error(settled, goal, 1e-3, 500), 1e-9);
  // Springs of 400 rad/s: (0.04)^4 of the motion at most.
  const auto exact = solution(rate, beside, 1.25e-4, 8000, 1.25e-4);
  double error[3] = {};
  for (int i = 0; i < 3; ++i) {
    const double h = 5e-4 / (1 << i);
    error[i] = distance(sampled_loop(law_at(h), State<8>(beside.head<8>()), FlexibleArm{},
                                     FlexibleArm::motor, goal, h, 2000 << i),
                        exact);
  }
  EXPECT_NEAR(std::log2(error[1] / error[2]), 1, 0.15) << error[1] << " " << error[2];
}

}  // namespace
}  // namespace tachless::controller::law::kelly_flexible_test

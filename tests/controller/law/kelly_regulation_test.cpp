#include "controller/law/rivals/kelly_regulation.h"

#include <gtest/gtest.h>

#include <limits>

#include "tests/controller/law/first_order.h"

namespace tachless::controller::law::kelly_regulation_test {
namespace {

TEST(KellyRegulation, IsGravityLessProportionalAndFilteredError) {
  const TwoLink<double> arm;
  const KellyRegulation::Gains gains{vector(300, 80), vector(40, 9), vector(60, 60),
                                     vector(50, 70)};
  const double h = 1e-3;
  const KellyRegulation law(two_link_model(), gains, {h, Discretisation::backward_euler});
  Random random(1);
  const Vector zero = Vector::Zero(2);
  for (int i = 0; i < 200; ++i) {
    const messages::ReferencePoint goal{random.pair(2), zero, zero, zero, zero};
    const messages::PositionMeasurement measured{random.pair(2)};
    const KellyRegulation::Memory memory{random.pair(2), random.pair(2)};
    const auto step = law.step(memory, measured, goal);
    const Pair e = measured.q - goal.q_ref;
    // nu_k = (nu_{k-1} + b (e_k - e_{k-1})) / (1 + a h)
    Pair nu;
    for (int j = 0; j < 2; ++j) {
      nu[j] = (memory.nu[j] + gains.b[j] * (e[j] - memory.e_previous[j])) / (1 + gains.a[j] * h);
    }
    const Pair tau = arm.g(measured.q) - gains.kp.cwiseProduct(e) - gains.kd.cwiseProduct(nu);
    // 20 eps of terms of up to 2e4 N m
    EXPECT_LE((step.command.tau - tau).norm(), 1e-10);
  }
}

TEST(KellyRegulation, ApproachesItsContinuousLoopAtFirstOrder) {
  const Sine goal{{0, 0}};
  const auto law_at = [](double h) {
    return KellyRegulation(two_link_model(),
                           {vector(900, 120), vector(120, 20), vector(90, 90), vector(90, 90)},
                           {h, Discretisation::tustin});
  };
  const auto rate = [](double /*t*/, const State<6>& x) {
    const Pair q = x.head<2>(), v = x.segment<2>(2), nu = x.tail<2>();
    const Pair tau =
        TwoLink<double>().g(q) - Pair(900, 120).cwiseProduct(q) - Pair(120, 20).cwiseProduct(nu);
    State<6> dot;
    dot << RigidArm{}(x.head<4>(), tau), 90 * (v - nu);
    return dot;
  };
  State<6> beside;
  beside << 0.5, -0.5, 0, 0, 0, 0;  // nu(0) = 0: the filter starts at the error
  expect_first_order(law_at, RigidArm::position, rate, beside, goal, 5e-4);
  // The slowest mode decays as exp(-7 t): 0.5 rad is 1e-12 after 4 s.
  EXPECT_LT(final_error(solution(rate, beside, 1e-3, 4000, 1e-3), goal, 1e-3, 100), 1e-9);
}

}  // namespace
}  // namespace tachless::controller::law::kelly_regulation_test

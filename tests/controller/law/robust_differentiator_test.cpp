#include "controller/law/rivals/robust_differentiator.h"

#include <gtest/gtest.h>

#include "tests/controller/law/first_order.h"
#include "tests/controller/law/velocity_error.h"

namespace tachless::controller::law::robust_differentiator_test {
namespace {

LevantDifferentiator::Gains gains(double L) {
  return {vector(4000, 1000), vector(400, 60), vector(L, L)};
}

/// Returns the largest errors of velocity and acceleration on the paper's reference from 0.1 s on.
/// The start is 1 rad/s off.
Pair largest_error(double period_s) {
  const LevantDifferentiator estimator(gains(3000), {period_s});
  messages::ReferencePoint first = paper_reference(0);
  first.v_ref += vector(1, 1);
  LevantDifferentiator::Memory memory = estimator.start(first.q_ref, first);
  Pair error(0, 0);
  for (int k = 1; (k - 1) * period_s < 0.4; ++k) {
    const messages::ReferencePoint now = paper_reference(k * period_s);
    memory = estimator.step(memory, now.q_ref);
    if (k * period_s < 0.1) continue;
    error = error.cwiseMax(
        Pair(std::abs(memory.z1[0] - now.v_ref[0]), std::abs(memory.z2[0] - now.a_ref[0])));
  }
  return error;
}

TEST(RobustDifferentiator, IsExactAfterAFiniteTimeButForItsSampling) {
  // By homogeneity the errors are L h^2 in velocity and L h in acceleration, times constants of
  // order 1.
  for (const double h : {1e-3, 5e-4, 2.5e-4}) {
    const Pair error = largest_error(h);
    EXPECT_LT(error[0], 3 * 3000 * h * h);
    EXPECT_LT(error[1], 6 * 3000 * h);
  }
  EXPECT_NEAR(largest_error(1e-3)[0] / largest_error(5e-4)[0], 4, 1);
}

TEST(RobustDifferentiator, CorrectsAsTheRecursiveFormOfTheSourceDoes) {
  const double h = 1e-3, L = 50;
  const LevantDifferentiator estimator(gains(L), {h});
  Random random(1);
  const auto sign = [](double x) { return x > 0 ? 1.0 : x < 0 ? -1.0 : 0.0; };
  for (int i = 0; i < 1000; ++i) {
    const LevantDifferentiator::Memory before{random.pair(1), random.pair(5), random.pair(50)};
    const Vector q = random.pair(1);
    const auto after = estimator.step(before, q);
    for (int j = 0; j < 2; ++j) {
      const double z0 = before.z0[j] + h * before.z1[j] + h * h / 2 * before.z2[j];
      const double z1 = before.z1[j] + h * before.z2[j], z2 = before.z2[j];
      const double v0 =
          -2 * std::pow(L, 1.0 / 3) * std::pow(std::abs(z0 - q[j]), 2.0 / 3) * sign(z0 - q[j]) + z1;
      const double v1 = -1.5 * std::sqrt(L) * std::sqrt(std::abs(z1 - v0)) * sign(z1 - v0) + z2;
      const double v2 = -1.1 * L * sign(z2 - v1);
      // The prediction already contains the chain of integrators, so v0 counts without z1, and v1
      // without z2. Only rounding remains.
      EXPECT_NEAR(after.z0[j], z0 + h * (v0 - z1), 1e-14);
      EXPECT_NEAR(after.z1[j], z1 + h * (v1 - z2), 1e-13);
      EXPECT_NEAR(after.z2[j], z2 + h * v2, 1e-12);
    }
  }
}

RobustDifferentiator law_at(double period_s, double L) {
  return {two_link_model(), gains(L), {period_s}};
}

const Sine reference{{0.5, 0.4}, 2.5};

TEST(RobustDifferentiator, ConvergesWhereTheLoopKeepsWithinItsBound) {
  // The arm starts with accelerations of some 30 rad/s^2, which z2 reaches within 3 ms at L = 1e4.
  // Then z1 is off by some 3 L h^2, times kd / kp.
  const auto error = [](double offset) {
    const double h = 2.5e-4;
    const auto states =
        sampled_loop(law_at(h, 1e4), rigid_state({offset, -offset}, reference.at(0).v_ref),
                     RigidArm{}, RigidArm::position, reference, h, 12000);
    return final_error(states, reference, h, 4000);
  };
  EXPECT_LT(error(0.01), 1e-3);
  // From farther away the accelerations are 20 times as large: the estimate is too late, and the
  // loop diverges.
  EXPECT_GT(error(0.2), 1);
}

TEST(RobustDifferentiator, ApproachesWenBayardAtFirstOrder) {
  // On the reference the differentiator starts exact and stays exact in continuous time. From
  // another start its own equation has no classical solution to compare with.
  const double L = 20;  // L; the reference has 7.8 rad/s^3
  expect_first_order([&](double h) { return law_at(h, L); }, RigidArm::position,
                     WenBayardLoop{{4000, 1000}, {400, 60}, reference},
                     rigid_state({0, 0}, reference.at(0).v_ref), reference, 5e-4);
}

TEST(RobustDifferentiator, HasAVelocityErrorBetweenTheKalmanFiltersOnThePapersReference) {
  double least = 1;
  for (double L = 300; L < 1e5; L *= 1.5) {
    least = std::min(least, velocity_error(LevantDifferentiator(gains(L), {1e-3})));
  }
  EXPECT_GT(least, 0.0096);
  EXPECT_LT(least, 0.028);
}

}  // namespace
}  // namespace tachless::controller::law::robust_differentiator_test

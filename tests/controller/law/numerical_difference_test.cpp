#include "controller/law/rivals/numerical_difference.h"

#include <gtest/gtest.h>

#include "tests/controller/law/first_order.h"
#include "tests/controller/law/velocity_error.h"

namespace tachless::controller::law::numerical_difference_test {
namespace {

NumericalDifference law_at(double period_s, int samples) {
  return {two_link_model(), {vector(4000, 1000), vector(400, 60), samples}, {period_s}};
}

const Sine reference{{0.5, 0.4}, 2.5};
const State<4> from_afar = rigid_state({0.2, -0.2}, {0, 0});

TEST(NumericalDifference, Converges) {
  // The lag of v_hat is 1.5 periods: kd * 1.5e-3 s * |vdot_ref| of some 3 rad/s^2, over kp.
  const auto states = sampled_loop(law_at(1e-3, 3), from_afar, RigidArm{}, RigidArm::position,
                                   reference, 1e-3, 3000);
  EXPECT_LT(final_error(states, reference, 1e-3, 1000), 1e-3);
}

TEST(NumericalDifference, ApproachesWenBayardAtFirstOrder) {
  // v_hat starts at v_ref(0), which the sampled loop forgets in 3 periods.
  const State<4> x0 = rigid_state({0.2, -0.2}, reference.at(0).v_ref);
  expect_first_order([](double h) { return law_at(h, 3); }, RigidArm::position,
                     WenBayardLoop{{4000, 1000}, {400, 60}, reference}, x0, reference, 1e-3);
}

TEST(NumericalDifference, OfAParabolaIsTheSlopeHalfwayBack) {
  const PositionDifference estimator({vector(1, 1), vector(1, 1), 4}, {1e-3});
  const auto q = [](int k) { return vector(3e-6 * k * k, 5e-3 * k); };
  PositionDifference::Memory memory = estimator.start(q(0), Sine{{0, 0}}.at(0));
  for (int k = 0; k <= 10; ++k) memory = estimator.step(memory, q(k));
  // Slopes at k = 8, per second; differences of 1e-4 over 4e-3, rounded.
  EXPECT_LT((estimator.velocity(memory) - vector(3e-6 * 16 * 1e3, 5)).norm(), 1e-12);
}

TEST(NumericalDifference, IsOverOnePeriodOrMore) {
  const base::Range samples = std::get<2>(NumericalDifference::Gains::keys).range;
  EXPECT_TRUE(samples.contains(1));
  EXPECT_FALSE(samples.contains(0));
}

TEST(NumericalDifference, StartsAtTheReferencesVelocity) {
  const NumericalDifference law = law_at(1e-3, 7);
  const messages::PositionMeasurement measured{vector(0.3, 0.4)};
  const messages::ReferencePoint now = reference.at(0.1);
  const auto step = law.step(law.start(measured, now), measured, now);
  EXPECT_LT((step.signals.value[1] - now.v_ref).norm(), 1e-12);
}

TEST(NumericalDifference, HasTheVelocityErrorThatCountsAndLagGive) {
  const auto error = [](int samples) {
    return velocity_error(PositionDifference({{}, {}, samples}, {1e-3}));
  };
  // With counts alone the error is sqrt(2) Delta / sqrt(12) / (m h) = 0.039 / m rad/s. With lag
  // alone it is m h / 2 of 22.2 rad/s^2 = 0.011 m.
  EXPECT_NEAR(error(1), 0.047, 0.0047);
  EXPECT_NEAR(error(2), 0.031, 0.0031);  // m h = sqrt(2 Delta / sup |vdot|) = 2.5 ms: the best
  EXPECT_NEAR(error(3), 0.036, 0.0036);
}

}  // namespace
}  // namespace tachless::controller::law::numerical_difference_test

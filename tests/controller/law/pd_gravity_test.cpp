#include "controller/law/rivals/pd_gravity.h"

#include <gtest/gtest.h>

#include "tests/controller/law/first_order.h"

namespace tachless::controller::law::pd_gravity_test {
namespace {

const Sine rest{{0, 0}};

PdGravity law_at(double period_s) {
  return {two_link_model(), {vector(4000, 1000), vector(400, 60)}, {period_s}};
}

TEST(PdGravity, Converges) {
  // The start is half a turn away. 3.5 s are 35 time constants of kd / kp = 0.1 s, so only rounding
  // remains.
  const auto states = sampled_loop(law_at(1e-3), rigid_state({3, 2}, {0, 0}), RigidArm{},
                                   full_state, rest, 1e-3, 4000);
  EXPECT_LT(final_error(states, rest, 1e-3, 500), 1e-10);
}

TEST(PdGravity, ItsEnergyFallsByWhatTheVelocityTermTakes) {
  // Vdot = -v' Kd v, by differences along the continuous loop.
  const TwoLink<double> arm;
  const PdGravity law = law_at(1e-3);
  const Vector zero = vector(0, 0);
  const messages::ReferencePoint reference{vector(0.4, -0.7), zero, zero, zero, zero};
  Random random(1);
  for (int i = 0; i < 100; ++i) {
    const Pair q = random.pair(3), v = random.pair(5);
    messages::StateMeasurement measured;
    measured.q = q;
    measured.v = v;
    const Pair vdot = arm.acceleration(q, v, law.step({}, measured, reference).command.tau);
    const auto V = [&](double t) {
      LoopState state;
      state.q = q + t * v + t * t / 2 * vdot;
      state.v = v + t * vdot;
      return law.lyapunov(state, reference, {});
    };
    const double rate = (V(1e-6) - V(-1e-6)) / 2e-6;
    // V of some 1e4 J, rounded, over 2e-6 s; third derivatives are less.
    EXPECT_NEAR(rate, -v.dot(Pair(400, 60).cwiseProduct(v)), 1e-4);
  }
}

TEST(PdGravity, ApproachesItsContinuousLoopAtFirstOrder) {
  const auto rate = [](double /*t*/, const State<4>& x) {
    const Pair q = x.head<2>(), v = x.tail<2>();
    return RigidArm{}(x, TwoLink<double>().g(q) - Pair(4000, 1000).cwiseProduct(q) -
                             Pair(400, 60).cwiseProduct(v));
  };
  expect_first_order(law_at, full_state, rate, rigid_state({-0.4, 0.7}, {0, 0}), rest, 1e-3);
}

}  // namespace
}  // namespace tachless::controller::law::pd_gravity_test

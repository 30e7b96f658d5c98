#include "controller/law/rivals/wen_bayard.h"

#include <gtest/gtest.h>

#include "tests/controller/law/first_order.h"

namespace tachless::controller::law::wen_bayard_test {
namespace {

TEST(WenBayard, MakesTheErrorEquationLinearInTheFeedbackTerms) {
  // Closed loop: M e_ddot + [C(q,v) + C(q,v_ref)] e_dot + Kp e + Kd e_dot = 0, by the closed form.
  const TwoLink<double> arm;
  const WenBayard::Gains gains{vector(400, 100), vector(60, 15)};
  const WenBayard law(two_link_model(), gains, {1e-3});
  Random random(1);
  for (int i = 0; i < 1000; ++i) {
    messages::StateMeasurement measured;
    measured.q = random.pair(3);
    measured.v = random.pair(5);
    const messages::ReferencePoint ref = random.reference();
    const auto step = law.step({}, measured, ref);
    const Pair tau = step.command.tau;
    const Pair q = measured.q, v = measured.v, v_ref = ref.v_ref;
    const Pair e = q - ref.q_ref, edot = v - v_ref;
    const Pair eddot = arm.acceleration(q, v, tau) - ref.a_ref;
    const Pair left = arm.M(q) * eddot + (arm.C(q, v) + arm.C(q, v_ref)) * edot;
    const Pair right = -gains.kp.cwiseProduct(e) - gains.kd.cwiseProduct(edot);
    // M^-1 and M again: cond(M) <= 23 times eps, of terms of some 1e3 N m.
    EXPECT_LE((left - right).norm(), 1e-11);
    EXPECT_EQ(step.signals.value[0], e);
    EXPECT_EQ(step.signals.value[1], edot);
  }
}

TEST(WenBayard, ApproachesItsContinuousLoopAtFirstOrder) {
  const Sine reference{{0.5, 0.4}, 2.5};
  const auto law_at = [](double h) {
    return WenBayard(two_link_model(), {vector(4000, 1000), vector(400, 60)}, {h});
  };
  expect_first_order(law_at, full_state, WenBayardLoop{{4000, 1000}, {400, 60}, reference},
                     rigid_state({0.2, -0.2}, {0, 0}), reference, 1e-3);
}

}  // namespace
}  // namespace tachless::controller::law::wen_bayard_test

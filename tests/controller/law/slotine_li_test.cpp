#include "controller/law/slotine_li.h"

#include <gtest/gtest.h>

#include "tests/controller/law/two_link.h"

namespace tachless::controller::law {
namespace {

TEST(SlotineLi, LeavesAPassiveErrorEquation) {
  // Closed loop: M sdot + C(q, v) s + Ks s = 0, by the closed form.
  const TwoLink<double> arm;
  const SlotineLi::Gains gains{vector(20, 30), vector(60, 15)};
  const SlotineLi law(two_link_model(), gains, {1e-3});
  Random random(1);
  for (int i = 0; i < 1000; ++i) {
    loop::StateMeasurement measured;
    measured.q = random.pair(3);
    measured.v = random.pair(5);
    const loop::ReferencePoint ref = random.reference();
    const auto step = law.step({}, measured, ref);
    const Pair tau = step.command.tau;
    const Pair q = measured.q, v = measured.v;
    const Pair e = q - ref.q_ref, edot = v - ref.v_ref;
    const Pair vdot = arm.acceleration(q, v, tau);
    const Pair s = edot + gains.lambda.cwiseProduct(e);
    const Pair sdot = vdot - ref.a_ref + gains.lambda.cwiseProduct(edot);
    const Pair left = arm.M(q) * sdot + arm.C(q, v) * s + gains.ks.cwiseProduct(s);
    // M^-1 and M again: cond(M) <= 23 times eps, of terms of some 1e4 N m.
    EXPECT_LE(left.norm(), 1e-10);
  }
}

}  // namespace
}  // namespace tachless::controller::law

#include "controller/law/rivals/slotine_li.h"

#include <gtest/gtest.h>

#include "tests/controller/law/first_order.h"

namespace tachless::controller::law::slotine_li_test {
namespace {

TEST(SlotineLi, LeavesAPassiveErrorEquation) {
  // Closed loop: M sdot + C(q, v) s + Ks s = 0, by the closed form.
  const TwoLink<double> arm;
  const SlotineLi::Gains gains{vector(20, 30), vector(60, 15)};
  const SlotineLi law(two_link_model(), gains, {1e-3});
  Random random(1);
  for (int i = 0; i < 1000; ++i) {
    messages::StateMeasurement measured;
    measured.q = random.pair(3);
    measured.v = random.pair(5);
    const messages::ReferencePoint ref = random.reference();
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

TEST(SlotineLi, ApproachesItsContinuousLoopAtFirstOrder) {
  const Sine reference{{0.5, 0.4}, 2.5};
  const auto rate = [&](double t, const State<4>& x) {
    const Pair q = x.head<2>(), v = x.tail<2>(), lambda(20, 15), ks(400, 40);
    const messages::ReferencePoint r = reference.at(t);
    const Pair v_r = Pair(r.v_ref) - lambda.cwiseProduct(q - Pair(r.q_ref));
    const Pair v_rdot = Pair(r.a_ref) - lambda.cwiseProduct(v - Pair(r.v_ref));
    const Pair tau = TwoLink<double>().torque(q, v, v_r, v_rdot) - ks.cwiseProduct(v - v_r);
    return RigidArm{}(x, tau);
  };
  const auto law_at = [](double h) {
    return SlotineLi(two_link_model(), {vector(20, 15), vector(400, 40)}, {h});
  };
  expect_first_order(law_at, full_state, rate, rigid_state({0.2, -0.2}, {0, 0}), reference, 1e-3);
}

}  // namespace
}  // namespace tachless::controller::law::slotine_li_test

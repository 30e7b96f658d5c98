#include "controller/law/rivals/computed_torque.h"

#include <gtest/gtest.h>

#include "tests/controller/law/first_order.h"

namespace tachless::controller::law::computed_torque_test {
namespace {

ComputedTorque law_at(double period_s) {
  return {two_link_model(), {vector(400, 900), vector(40, 60)}, {period_s}};
}

TEST(ComputedTorque, MakesTheErrorEquationLinearAndDecoupled) {
  // eddot + Kd edot + Kp e = 0, by the closed form.
  const TwoLink<double> arm;
  const ComputedTorque law = law_at(1e-3);
  Random random(1);
  for (int i = 0; i < 1000; ++i) {
    messages::StateMeasurement measured;
    measured.q = random.pair(3);
    measured.v = random.pair(5);
    const messages::ReferencePoint ref = random.reference();
    const Pair tau = law.step({}, measured, ref).command.tau;
    const Pair q = measured.q, v = measured.v;
    const Pair e = q - ref.q_ref, edot = v - ref.v_ref;
    const Pair eddot = arm.acceleration(q, v, tau) - ref.a_ref;
    const Pair left = eddot + Pair(40, 60).cwiseProduct(edot) + Pair(400, 900).cwiseProduct(e);
    // M^-1 and M again: cond(M) <= 23 times eps, of accelerations of some 1e4.
    EXPECT_LE(left.norm(), 1e-10);
  }
}

const Sine reference{{0.5, 0.4}, 2.5};
const State<4> from_afar = rigid_state({0.2, -0.2}, {0, 0});

TEST(ComputedTorque, Converges) {
  const auto states =
      sampled_loop(law_at(1e-3), from_afar, RigidArm{}, full_state, reference, 1e-3, 3000);
  // A held torque is half a period late. The error is 0.5e-3 s times jerks of some 10 rad/s^3, over
  // kp.
  EXPECT_LT(final_error(states, reference, 1e-3, 1000), 1e-4);
}

TEST(ComputedTorque, ApproachesItsContinuousLoopAtFirstOrder) {
  const auto rate = [](double t, const State<4>& x) {
    const Pair q = x.head<2>(), v = x.tail<2>();
    const messages::ReferencePoint r = reference.at(t);
    const Pair wanted = Pair(r.a_ref) - Pair(40, 60).cwiseProduct(v - Pair(r.v_ref)) -
                        Pair(400, 900).cwiseProduct(q - Pair(r.q_ref));
    return RigidArm{}(x, TwoLink<double>().torque(q, v, v, wanted));
  };
  expect_first_order(law_at, full_state, rate, from_afar, reference, 1e-3);
}

}  // namespace
}  // namespace tachless::controller::law::computed_torque_test

#include "controller/law/rivals/slotine_li_flexible.h"

#include <gtest/gtest.h>

#include "tests/controller/law/closed_loop.h"

namespace tachless::controller::law::slotine_li_flexible_test {
namespace {

using Long = long double;
using LongPair = TwoLink<Long>::Pair;

const Vector lambda = vector(12, 20);

SlotineLiFlexible example() {
  return {
      {two_link_model(), stiffness, rotor_inertia}, {lambda, vector(80, 20), vector(12, 16)}, {}};
}

LongPair lengthen(const Vector& x) { return x.cast<Long>(); }

TEST(SlotineLiFlexible, LeavesAPassiveErrorEquation) {
  // Closed loop: M s1dot + C(q, v) s1 + Ks1 s1 + K (e1 - e2) = 0,
  //              J s2dot + Ks2 s2 + K (e2 - e1) = 0,
  // with theta_ref and its derivatives from differences of the closed form along the motion, whose
  // link jerk is that of eq. 1.
  const TwoLink<Long> arm;
  const SlotineLiFlexible law = example();
  const LongPair K = lengthen(stiffness), J = lengthen(rotor_inertia);
  const LongPair ks1 = lengthen(vector(80, 20)), ks2 = lengthen(vector(12, 16));
  Random random(1);
  for (int i = 0; i < 300; ++i) {
    messages::StateMeasurement measured;
    measured.q = random.pair(3);
    measured.v = random.pair(3);
    measured.theta = measured.q + random.pair(0.05);
    measured.thetadot = measured.v + random.pair(2);
    const messages::ReferencePoint ref = random.reference();
    const auto step = law.step({}, measured, ref);

    const LongPair q0 = lengthen(measured.q), v0 = lengthen(measured.v),
                   th0 = lengthen(measured.theta), thd0 = lengthen(measured.thetadot);
    const LongPair spring = K.cwiseProduct(th0 - q0);
    const LongPair w0 = arm.acceleration(q0, v0, spring);
    // Link jerk is the change of the acceleration along the motion, by a fourth-order difference.
    const auto acceleration = [&](Long t) -> LongPair {
      const LongPair q = q0 + t * (v0 + t / 2 * w0), v = v0 + t * w0, th = th0 + t * thd0;
      return arm.acceleration(q, v, K.cwiseProduct(th - q));
    };
    const Long d = 1e-5L;
    const LongPair jerk =
        (8 * (acceleration(d) - acceleration(-d)) - (acceleration(2 * d) - acceleration(-2 * d))) /
        (12 * d);
    const LongPair r0 = lengthen(ref.q_ref), r1 = lengthen(ref.v_ref), r2 = lengthen(ref.a_ref),
                   r3 = lengthen(ref.jerk_ref), r4 = lengthen(ref.snap_ref);
    const LongPair L = lengthen(lambda);
    const auto theta_ref = [&](Long t) -> LongPair {
      const LongPair q = q0 + t * (v0 + t / 2 * (w0 + t / 3 * jerk));
      const LongPair v = v0 + t * (w0 + t / 2 * jerk);
      const LongPair q_ref = r0 + t * (r1 + t / 2 * (r2 + t / 3 * (r3 + t / 4 * r4)));
      const LongPair v_ref = r1 + t * (r2 + t / 2 * (r3 + t / 3 * r4));
      const LongPair a_ref = r2 + t * (r3 + t / 2 * r4);
      const LongPair v_r = v_ref - L.cwiseProduct(q - q_ref);
      const LongPair a_r = a_ref - L.cwiseProduct(v - v_ref);
      const LongPair torque = arm.torque(q, v, v_r, a_r) - ks1.cwiseProduct(v - v_r);
      return q_ref + torque.cwiseQuotient(K);
    };
    const Long h = 2e-4L;
    const Long first[4] = {4 / 5.0L, -1 / 5.0L, 4 / 105.0L, -1 / 280.0L};
    const Long second[5] = {-205 / 72.0L, 8 / 5.0L, -1 / 5.0L, 8 / 315.0L, -1 / 560.0L};
    LongPair dot = LongPair::Zero(), ddot = second[0] * theta_ref(0);
    for (int j = 1; j <= 4; ++j) {
      dot += first[j - 1] * (theta_ref(j * h) - theta_ref(-j * h));
      ddot += second[j] * (theta_ref(j * h) + theta_ref(-j * h));
    }
    dot /= h;
    ddot /= h * h;

    const LongPair e1 = q0 - r0, s1 = v0 - r1 + L.cwiseProduct(e1);
    const LongPair s1dot = w0 - r2 + L.cwiseProduct(v0 - r1);
    const LongPair e2 = th0 - theta_ref(0), e2dot = thd0 - dot, s2 = e2dot + L.cwiseProduct(e2);
    const LongPair thetaddot = (lengthen(step.command.tau) - spring).cwiseQuotient(J);
    const LongPair s2dot = thetaddot - ddot + L.cwiseProduct(e2dot);
    const LongPair link =
        arm.M(q0) * s1dot + arm.C(q0, v0) * s1 + ks1.cwiseProduct(s1) + K.cwiseProduct(e1 - e2);
    const LongPair rotor = J.cwiseProduct(s2dot) + ks2.cwiseProduct(s2) + K.cwiseProduct(e2 - e1);
    const Long size = spring.norm() + K.cwiseProduct(e1 - e2).norm() + J.cwiseProduct(ddot).norm() +
                      (arm.M(q0) * s1dot).norm();
    // theta_ref alone fulfils the first line, in extended precision. The law fulfils the second:
    // measured 4.7e-15 of the terms at worst, bound ten times that.
    EXPECT_LE(link.norm(), 2e-17L * size);
    EXPECT_LE(rotor.norm(), 4.7e-14L * size);
  }
}

/// The law has no memory, so its torque depends on state and time alone; the test above has checked
/// this torque.
TEST(SlotineLiFlexible, ConvergesAndApproachesItsContinuousLoopAtFirstOrder) {
  const SlotineLiFlexible law = example();
  const Sine reference;
  const auto rate = [&](double t, const State<8>& x) {
    const Vector tau = law.step({}, FlexibleArm::state(x), reference.at(t)).command.tau;
    return FlexibleArm{}(x, tau);
  };
  State<8> beside;
  beside << 0.1, -0.1, 0.1, -0.1, 0, 0, 0, 0;
  const auto exact = solution(rate, beside, 2.5e-4, 24'000, 2.5e-4);
  EXPECT_LT(final_error(exact, reference, 2.5e-4, 500), 1e-9);
  double error[3] = {};
  for (int i = 0; i < 3; ++i) {
    const double h = 1e-3 / (1 << i);
    error[i] = distance(
        sampled_loop(law, beside, FlexibleArm{}, FlexibleArm::state, reference, h, 1000 << i),
        std::vector<State<8>>(exact.begin(), exact.begin() + 4001));
  }
  EXPECT_NEAR(std::log2(error[1] / error[2]), 1, 0.15) << error[1] << " " << error[2];
}

TEST(SlotineLiFlexible, NeedsMotorVelocityForTheLinkJerkUnlikeThePapersLaw) {
  const SlotineLiFlexible law = example();
  Random random(2);
  messages::StateMeasurement measured{random.pair(1), random.pair(1), random.pair(1),
                                      random.pair(1)};
  const messages::ReferencePoint ref = random.reference();
  const Vector before = robot::second_derivative(law.motor_reference(measured, ref));
  measured.thetadot += vector(1, 0);
  const Vector after = robot::second_derivative(law.motor_reference(measured, ref));
  EXPECT_GT((after - before).norm(), 1);
}

TEST(SlotineLiFlexible, IsTunedToPolesOfTheBandwidthAndDamping) {
  Tuning tuning;
  tuning.w = 10;
  tuning.damping = 0.5;
  tuning.inertia = vector(2, 0.5);
  tuning.rotor = tuning.stiffness = vector(1, 1);
  const SlotineLiFlexible::Gains tuned = SlotineLiFlexible::tuned(tuning);
  // The link alone has s^2 + (ks1 / M + lambda) s + ks1 lambda / M.
  EXPECT_EQ(tuned.ks1.cwiseProduct(tuned.lambda), 100 * tuning.inertia);
  EXPECT_EQ(tuned.ks1, vector(10, 2.5));
}

}  // namespace
}  // namespace tachless::controller::law::slotine_li_flexible_test

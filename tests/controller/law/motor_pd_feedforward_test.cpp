#include "controller/law/rivals/motor_pd_feedforward.h"

#include <gtest/gtest.h>

#include "tests/controller/law/closed_loop.h"

namespace tachless::controller::law::motor_pd_feedforward_test {
namespace {

const MotorPdFeedforward::Gains gains{vector(4000, 1000), vector(80, 40)};

MotorPdFeedforward law_with(double payload) {
  return {{model_with(payload), stiffness, rotor_inertia}, gains, {}};
}

/// Returns theta_ref and its derivatives by differences of the closed form along the reference, in
/// extended precision.
struct MotorReference {
  Pair theta, thetadot, thetaddot, torque;
};
MotorReference motor_reference(double payload, const Sine& reference, double t) {
  using Long = long double;
  using LongPair = TwoLink<Long>::Pair;
  const TwoLink<Long> arm{payload};
  const LongPair a = reference.amplitude.cast<Long>(), K = stiffness.cast<Long>();
  const Long w = reference.omega;
  const auto torque = [&](Long at) -> LongPair {
    const LongPair q = a * std::sin(w * at), v = a * (w * std::cos(w * at)), acc = -w * w * q;
    return arm.torque(q, v, v, acc);
  };
  const auto theta = [&](Long at) -> LongPair {
    return a * std::sin(w * at) + torque(at).cwiseQuotient(K);
  };
  const Long d = 1e-3L;
  const LongPair first =
      (8 * (theta(t + d) - theta(t - d)) - (theta(t + 2 * d) - theta(t - 2 * d))) / (12 * d);
  const LongPair second =
      (16 * (theta(t + d) + theta(t - d)) - (theta(t + 2 * d) + theta(t - 2 * d)) - 30 * theta(t)) /
      (12 * d * d);
  return {theta(t).cast<double>(), first.cast<double>(), second.cast<double>(),
          torque(t).cast<double>()};
}

/// The loop in continuous time, with K (theta_ref - q_ref) = ID on the reference.
struct Continuous {
  FlexibleArm robot;
  Sine reference;

  State<8> operator()(double t, const State<8>& x) const {
    const MotorReference r = motor_reference(robot.arm.payload, reference, t);
    const Pair tau = Pair(rotor_inertia).cwiseProduct(r.thetaddot) + r.torque -
                     Pair(4000, 1000).cwiseProduct(x.segment<2>(2) - r.theta) -
                     Pair(80, 40).cwiseProduct(x.segment<2>(6) - r.thetadot);
    return robot(x, tau);
  }
};

/// Returns a state beside the reference, at rest, with links and motors displaced equally.
State<8> beside() {
  State<8> x;
  x << 0.05, -0.05, 0.05, -0.05, 0, 0, 0, 0;
  return x;
}

TEST(MotorPdFeedforward, ConvergesWithAndWithoutAPayloadThatTheModelKnows) {
  const Sine reference;
  for (const double payload : {0.0, 0.5}) {
    const Continuous exact{{{payload}}, reference};
    const auto states = solution(exact, beside(), 1e-3, 8000, 1e-3);
    // The slowest modes decay as exp(-2 t): 0.05 rad is 1e-8 after 7.5 s; measured 3e-9 and 4e-8.
    EXPECT_LT(final_error(states, reference, 1e-3, 500), 4e-7) << payload;
    const auto sampled = sampled_loop(law_with(payload), beside(), FlexibleArm{{payload}},
                                      FlexibleArm::state, reference, 1e-3, 8000);
    // A feed-forward half a period old, some 10 N m/s * 0.5 ms, on Kp and K; measured 1.2e-6 and
    // 1.3e-6.
    EXPECT_LT(final_error(sampled, reference, 1e-3, 500), 5e-6) << payload;
  }
}

TEST(MotorPdFeedforward, ApproachesItsContinuousEquationsWithFirstOrder) {
  const Sine reference{{0.3, -0.4}, 3};
  const Continuous exact{{}, reference};
  const auto continuous = solution(exact, beside(), 1.25e-4, 3200, 6.25e-5);
  double error[3] = {};
  for (int i = 0; i < 3; ++i) {
    const double h = 5e-4 / (1 << i);
    error[i] = distance(sampled_loop(law_with(0), beside(), FlexibleArm{}, FlexibleArm::state,
                                     reference, h, 800 << i),
                        continuous);
  }
  // The order is 1, because the torque is held over the period. The second-order term's effect
  // shrinks by half: measured 1.952 and 1.977.
  EXPECT_NEAR(error[0] / error[1], 2, 0.2) << error[0];
  EXPECT_NEAR(error[1] / error[2], 2, 0.1) << error[1];
}

TEST(MotorPdFeedforward, IsItsFormula) {
  const MotorPdFeedforward law = law_with(0);
  Random random(1);
  for (int i = 0; i < 100; ++i) {
    const Sine reference{random.pair(1), random.between(1, 3)};
    const double t = random.between(0, 3);
    const MotorReference r = motor_reference(0, reference, t);
    const messages::StateMeasurement measured{random.pair(1), random.pair(3), random.pair(1),
                                              random.pair(3)};
    const auto step = law.step({}, measured, reference.at(t));
    const Pair e = Pair(measured.theta) - r.theta, edot = Pair(measured.thetadot) - r.thetadot;
    const Pair tau = Pair(rotor_inertia).cwiseProduct(r.thetaddot) + r.torque -
                     Pair(4000, 1000).cwiseProduct(e) - Pair(80, 40).cwiseProduct(edot);
    EXPECT_LT((step.signals.value[0] - e).norm(), 1e-14);  // some roundings of up to 2 rad
    // The differences' error, d^4 / 30 of a fifth derivative of up to 3^5 and its harmonics, and
    // Kv times it.
    EXPECT_LT((step.signals.value[1] - edot).norm(), 1e-10);
    EXPECT_LT((step.command.tau - tau).norm(), 1e-8);
  }
}

TEST(MotorPdFeedforward, TakesNothingFromTheLinks) {
  const MotorPdFeedforward law = law_with(0);
  Random random(2);
  messages::StateMeasurement measured{random.pair(1), random.pair(1), random.pair(1),
                                      random.pair(1)};
  const messages::ReferencePoint ref = random.reference();
  const Vector before = law.step({}, measured, ref).command.tau;
  measured.q = random.pair(1);
  measured.v = random.pair(1);
  EXPECT_EQ(law.step({}, measured, ref).command.tau, before);
}

}  // namespace
}  // namespace tachless::controller::law::motor_pd_feedforward_test

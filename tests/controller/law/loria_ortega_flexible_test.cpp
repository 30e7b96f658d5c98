#include "controller/law/loria_ortega_flexible.h"

#include <gtest/gtest.h>

#include <limits>

#include "tests/controller/law/two_link.h"

namespace tachless::controller::law::loria_ortega_flexible_test {
namespace {

using Long = long double;
using LongPair = TwoLink<Long>::Pair;

const Vector stiffness = vector(1e4, 8e3);
const Vector rotor_inertia = vector(0.1, 0.2);

/// Draws a law, a state of the arm and a reference.
struct Draw {
  LoriaOrtegaFlexible::Gains gains;
  LoriaOrtegaFlexible law;
  LoriaOrtegaFlexible::Memory memory;
  messages::LinkStateMeasurement measured;
  messages::ReferencePoint ref;

  explicit Draw(Random& random)
      : gains{random.positive(100, 10000), random.positive(10, 9000),  random.positive(100, 1000),
              random.positive(100, 1000),  random.positive(10, 10000), random.positive(10, 9000),
              random.positive(100, 1000),  random.positive(100, 1000)},
        law({two_link_model(), stiffness, rotor_inertia}, gains, Settings{1e-4}),
        memory{{random.pair(5), random.pair(0.1)}, {random.pair(5), random.pair(0.1)}},
        measured{random.pair(3), random.pair(3), {}},
        ref(random.reference()) {
    measured.theta = measured.q + random.pair(0.05);
  }
};

LongPair lengthen(const Vector& x) { return x.cast<Long>(); }

/// Returns theta_ref and its second time derivative, computed apart from the law (the display after
/// eq. 10). It uses the closed form in extended precision along a path through the state with an
/// arbitrary link jerk. The second derivative is an eighth-order difference over this path.
struct Independent {
  LongPair theta_ref, thetaddot_ref;

  Independent(const Draw& draw, const Vector& nu1, const Vector& vdot, const Vector& link_jerk) {
    const TwoLink<Long> arm;
    const LongPair K = lengthen(stiffness), kp = lengthen(draw.gains.kp1),
                   kd = lengthen(draw.gains.kd1), a1 = lengthen(draw.gains.a1),
                   b1 = lengthen(draw.gains.b1);
    const LongPair q0 = lengthen(draw.measured.q), v0 = lengthen(draw.measured.v),
                   w0 = lengthen(vdot), jerk = lengthen(link_jerk), nu = lengthen(nu1);
    const LongPair r0 = lengthen(draw.ref.q_ref), r1 = lengthen(draw.ref.v_ref),
                   r2 = lengthen(draw.ref.a_ref), r3 = lengthen(draw.ref.jerk_ref),
                   r4 = lengthen(draw.ref.snap_ref);
    const LongPair nu_dot = b1.cwiseProduct(v0 - r1) - a1.cwiseProduct(nu);
    const LongPair nu_ddot = b1.cwiseProduct(w0 - r2) - a1.cwiseProduct(nu_dot);
    const auto at = [&](Long t) -> LongPair {
      const LongPair q = q0 + t * (v0 + t / 2 * (w0 + t / 3 * jerk));
      const LongPair q_ref = r0 + t * (r1 + t / 2 * (r2 + t / 3 * (r3 + t / 4 * r4)));
      const LongPair v_ref = r1 + t * (r2 + t / 2 * (r3 + t / 3 * r4));
      const LongPair a_ref = r2 + t * (r3 + t / 2 * r4);
      const LongPair filtered = nu + t * (nu_dot + t / 2 * nu_ddot);
      const LongPair torque = arm.torque(q, v_ref, v_ref, a_ref) - kp.cwiseProduct(q - q_ref) -
                              kd.cwiseProduct(filtered);
      return q_ref + torque.cwiseQuotient(K);
    };
    const Long h = 5e-4L;
    const Long weight[5] = {-205 / 72.0L, 8 / 5.0L, -1 / 5.0L, 8 / 315.0L, -1 / 560.0L};
    theta_ref = at(0);
    thetaddot_ref = weight[0] * theta_ref;
    for (int j = 1; j <= 4; ++j) {
      thetaddot_ref += weight[j] * (at(j * h) + at(-j * h));
    }
    thetaddot_ref /= h * h;
  }
};

TEST(LoriaOrtegaFlexible, ClosedLoopIsThePapersErrorEquation) {
  // Eq. 29: blockdiag(M_l, J) [e1ddot; e2ddot] + [C(q,v) + C(q,v_ref)] e1dot
  //         + [Kp1 + K, -K; -K, Kp2 + K] [e1; e2] + [Kd1 nu1; Kd2 nu2] = 0.
  const TwoLink<Long> arm;
  Random random(1);
  for (int i = 0; i < 1000; ++i) {
    const Draw draw(random);
    const auto step = draw.law.step(draw.memory, draw.measured, draw.ref);
    const Vector spring =
        stiffness.cwiseProduct(draw.measured.theta - draw.measured.q);  // on the links
    const Vector vdot = robot::forward_dynamics(two_link_model(), draw.measured.q, draw.measured.v,
                                                spring);  // eq. 1
    const Independent motor(draw, step.signals.value[1], vdot, random.pair(1e4));

    const LongPair q = lengthen(draw.measured.q), v = lengthen(draw.measured.v),
                   v_ref = lengthen(draw.ref.v_ref), K = lengthen(stiffness);
    const LongPair e1 = q - lengthen(draw.ref.q_ref), e1dot = v - v_ref;
    const LongPair e2 = lengthen(draw.measured.theta) - motor.theta_ref;
    const LongPair e1ddot = lengthen(vdot) - lengthen(draw.ref.a_ref);
    const LongPair J_e2ddot = lengthen(step.command.tau) - lengthen(spring) -
                              lengthen(rotor_inertia).cwiseProduct(motor.thetaddot_ref);
    const LongPair nu1 = lengthen(step.signals.value[1]), nu2 = lengthen(step.signals.value[3]);

    const LongPair link[] = {arm.M(q) * e1ddot, (arm.C(q, v) + arm.C(q, v_ref)) * e1dot,
                             lengthen(draw.gains.kp1).cwiseProduct(e1), K.cwiseProduct(e1 - e2),
                             lengthen(draw.gains.kd1).cwiseProduct(nu1)};
    const LongPair rotor[] = {J_e2ddot, K.cwiseProduct(e2 - e1),
                              lengthen(draw.gains.kp2).cwiseProduct(e2),
                              lengthen(draw.gains.kd2).cwiseProduct(nu2)};
    LongPair sum_link = LongPair::Zero(), sum_rotor = LongPair::Zero();
    Long size_link = 0;
    for (const LongPair& term : link) {
      sum_link += term;
      size_link += term.norm();
    }
    Long size_rotor = lengthen(rotor_inertia).cwiseProduct(motor.thetaddot_ref).norm();
    for (const LongPair& term : rotor) {
      sum_rotor += term;
      size_rotor += term.norm();
    }
    // Recursion and jets in double: measured 1.3e-16 of the terms at worst, allow ten times that.
    EXPECT_LE(sum_link.norm(), 1.3e-15L * size_link);
    EXPECT_LE(sum_rotor.norm(), 1.3e-15L * size_rotor);
    EXPECT_LE((lengthen(step.signals.value[2]) - e2).norm(), 1e-13L * (1 + motor.theta_ref.norm()));
  }
}

TEST(LoriaOrtegaFlexible, LinkJerkDoesNotEnterTheMotorReference) {
  // The independent second derivative is the same for any jerk of its path, so the law needs no
  // jerk.
  Random random(2);
  const Draw draw(random);
  const auto step = draw.law.step(draw.memory, draw.measured, draw.ref);
  const Vector vdot = robot::forward_dynamics(
      two_link_model(), draw.measured.q, draw.measured.v,
      Vector(stiffness.cwiseProduct(draw.measured.theta - draw.measured.q)));
  const Independent none(draw, step.signals.value[1], vdot, vector(0, 0));
  const Independent much(draw, step.signals.value[1], vdot, vector(3e4, -2e4));
  // The fourth derivative of theta_ref contains the jerk; the difference formula has no error
  // there. Its eighth-order term, h^8 / 3150, has a trace of the jerk.
  EXPECT_LE((none.thetaddot_ref - much.thetaddot_ref).norm(), 1e-9L * none.thetaddot_ref.norm());
  EXPECT_GT(none.thetaddot_ref.norm(), 1);
}

/// A measurement with motor velocity, acceleration or jerk, by the project's names for them.
template <class Measurement>
concept HoldsMoreThanLinkStateAndMotorPosition = requires(Measurement m) {
  m.thetadot;
}
|| requires(Measurement m) { m.vdot; }
|| requires(Measurement m) { m.a; }
|| requires(Measurement m) { m.jerk; };

TEST(LoriaOrtegaFlexible, MeasuresLinkStateAndMotorPositionAndNoMore) {
  using Measurement = LoriaOrtegaFlexible::Measurement;
  static_assert(!HoldsMoreThanLinkStateAndMotorPosition<Measurement>);
  static_assert(sizeof(Measurement) == 3 * sizeof(Vector));
  static_assert(!std::is_convertible_v<messages::StateMeasurement, Measurement>);
}

TEST(LoriaOrtegaFlexible, TorqueDoesNotDependOnWhatIsNotMeasured) {
  // The step is a pure function of memory, measurement and reference: a second call returns the
  // same.
  Random random(3);
  for (int i = 0; i < 20; ++i) {
    const Draw draw(random);
    const auto one = draw.law.step(draw.memory, draw.measured, draw.ref);
    const auto two = draw.law.step(draw.memory, draw.measured, draw.ref);
    EXPECT_EQ(one.command.tau, two.command.tau);
  }
}

TEST(LoriaOrtegaFlexible, StartsBothFiltersWithoutAKick) {
  Random random(4);
  for (int i = 0; i < 20; ++i) {
    const Draw draw(random);
    const auto step =
        draw.law.step(draw.law.start(draw.measured, draw.ref), draw.measured, draw.ref);
    EXPECT_EQ(step.signals.value[1], vector(0, 0));
    EXPECT_EQ(step.signals.value[3], vector(0, 0));
  }
}

TEST(LoriaOrtegaFlexible, AtRestOnItsGoalItBalancesGravity) {
  const TwoLink<double> arm;
  Random random(5);
  for (int i = 0; i < 20; ++i) {
    const Draw draw(random);
    const Vector zero = Vector::Zero(2);
    const messages::ReferencePoint goal{draw.ref.q_ref, zero, zero, zero, zero};
    const Pair g = arm.g(goal.q_ref);
    const messages::LinkStateMeasurement measured{goal.q_ref, zero,
                                                  goal.q_ref + g.cwiseQuotient(stiffness)};
    const auto step = draw.law.step(draw.law.start(measured, goal), measured, goal);
    // theta's rounding, times K / M of the forward dynamics, times Kp1 + Kd1 B1 on its way to tau:
    // 4e-16 * 8e3 / 0.45 * 9e6 * 0.2 / 8e3.
    EXPECT_LE((step.command.tau - g).norm(), 1e-8);
  }
}

}  // namespace
}  // namespace tachless::controller::law::loria_ortega_flexible_test

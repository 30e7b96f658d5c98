#include "controller/law/flexible_position.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>

#include "messages/measurements.h"
#include "tests/core/robot/robots.h"

namespace tachless::controller::law::flexible_position_test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// A law, a state of its arm and a reference, with the derivatives that the plant's equations give.
/// Links and motors obey eq. 1; the filters obey their continuous equations.
struct Draw {
  robot::Model links;
  Vector K, J;
  FlexiblePosition::Gains gains;
  ReferencePoint ref;
  LoopState state;
  VectorXd e1, e1dot, e1ddot, nu1, nu1dot, z, zdot, w, wdot, nu2, nu2dot;
  MatrixXd M, Mdot, C, Cd, G;
  VectorXd n;
  double energy = 0;  ///< by the law

  Draw(robot::Model model, robot::testing::Random& random) : links(std::move(model)) {
    const Eigen::Index joints = links.num_joints;
    const auto between = [&](double least, double most) -> Vector {
      return (least + (most - least) * 0.5 * (random.vector(joints, 1).array() + 1)).matrix();
    };
    K = between(1e3, 2e4);
    J = between(0.05, 1);
    gains = {between(100, 1e4), between(10, 1000), between(100, 1000), between(100, 1000),
             between(0.5, 3),   between(5, 100),   between(100, 1000), between(100, 1000)};
    ref = {random.vector(joints, 2), random.vector(joints, 2), random.vector(joints, 20),
           random.vector(joints, 100), random.vector(joints, 1000)};
    state.q = random.vector(joints, 3);
    state.v = random.vector(joints, 3);
    state.theta = state.q + random.vector(joints, 0.05);
    state.thetadot = random.vector(joints, 3);
    derive(random);
  }

 private:
  void derive(robot::testing::Random& random) {
    const Eigen::Index joints = links.num_joints;
    const FlexiblePosition law({links, K, J}, gains, Settings{1e-4});
    const messages::BothPositionsMeasurement measured{state.q, state.theta};
    const FlexiblePosition::Memory memory{{random.vector(joints, 5), random.vector(joints, 0.1)},
                                          {random.vector(joints, 5), random.vector(joints, 0.1)}};
    const auto step = law.step(memory, measured, ref);
    state.controller = step.signals;
    nu1 = step.signals.value[1];
    nu2 = step.signals.value[3];
    z = step.signals.value[4];
    const Vector spring = K.cwiseProduct(state.theta - state.q);
    const Vector vdot = robot::forward_dynamics(links, state.q, state.v, spring);
    const Vector thetaddot = (step.command.tau - spring).cwiseQuotient(J);
    e1 = state.q - ref.q_ref;
    e1dot = state.v - ref.v_ref;
    e1ddot = vdot - ref.a_ref;
    const auto rate = [](const Vector& a, const Vector& b, const VectorXd& nu,
                         const VectorXd& edot) -> VectorXd {
      return VectorXd(b).cwiseProduct(edot) - VectorXd(a).cwiseProduct(nu);
    };
    nu1dot = rate(gains.a1, gains.b1, nu1, e1dot);
    const robot::JetVector theta_d = law.motor_reference(ref);
    w = state.thetadot - robot::first_derivative(theta_d);
    wdot = thetaddot - robot::second_derivative(theta_d);
    nu2dot = rate(gains.a2, gains.b2, nu2, w);
    const ReferenceJets r(ref);
    const Vector t1dot = robot::first_derivative(robot::inverse_dynamics(
                             links, robot::jet(state.q, state.v, vdot), r.v, r.a)) -
                         gains.kp1.cwiseProduct(Vector(e1dot)) -
                         gains.kd1.cwiseProduct(Vector(nu1dot));
    zdot = K.cwiseProduct(state.thetadot - state.v) - t1dot;
    matrices(vdot);
    energy = law.lyapunov(state, ref, {});
  }

  void matrices(const Vector& vdot) {
    const Eigen::Index joints = links.num_joints;
    const Vector zero = Vector::Zero(joints);
    const auto jets = robot::mass_matrix(links, robot::jet(state.q, state.v, vdot));
    M.resize(joints, joints);
    Mdot.resize(joints, joints);
    G.resize(joints, joints);
    for (Eigen::Index i = 0; i < joints; ++i) {
      for (Eigen::Index j = 0; j < joints; ++j) {
        M(i, j) = jets(i, j).value;
        Mdot(i, j) = jets(i, j).first;
      }
      const Vector unit = Vector::Unit(joints, i);
      G.col(i) = robot::first_derivative(robot::inverse_dynamics(
          links, robot::jet(state.q, unit, zero), robot::jet(ref.v_ref, zero, zero),
          robot::jet(ref.a_ref, zero, zero)));
    }
    C = robot::coriolis_matrix(links, state.q, state.v);
    Cd = robot::coriolis_matrix(links, state.q, ref.v_ref);
    const auto along_the_reference = [&](const Vector& q) -> VectorXd {
      return robot::first_derivative(robot::inverse_dynamics(
          links, robot::jet(q, ref.v_ref, zero), robot::jet(ref.v_ref, ref.a_ref, zero),
          robot::jet(ref.a_ref, ref.jerk_ref, zero)));
    };
    n = along_the_reference(state.q) - along_the_reference(ref.q_ref);
  }
};

/// A sum of terms that has to be zero, against the size of its terms.
struct Balance {
  VectorXd sum;
  double size = 0;

  void add(const VectorXd& term) {
    sum = sum.size() == 0 ? term : VectorXd(sum + term);
    size += term.norm();
  }
};

class FlexiblePositionProof : public testing::TestWithParam<bool> {
 protected:
  static Draw draw(robot::testing::Random& random) {
    return {GetParam() ? robot::testing::iiwa7() : robot::testing::two_link(), random};
  }
};
INSTANTIATE_TEST_SUITE_P(Arms, FlexiblePositionProof, testing::Values(false, true),
                         [](const auto& arm) { return arm.param ? "SevenJoints" : "TwoJoints"; });

TEST_P(FlexiblePositionProof, ClosedLoopIsTheErrorEquation) {
  robot::testing::Random random(1);
  for (int i = 0; i < 1000; ++i) {
    const Draw d = draw(random);
    const VectorXd K = d.K, J = d.J, kp = d.gains.kp1, kd = d.gains.kd1, a1 = d.gains.a1,
                   b1 = d.gains.b1, beta = d.gains.beta, kd2 = d.gains.kd2;
    Balance link, motor, spring;
    link.add(d.M * d.e1ddot);
    link.add((d.C + d.Cd) * d.e1dot);
    link.add(kp.cwiseProduct(d.e1));
    link.add(kd.cwiseProduct(d.nu1));
    link.add(-d.z);
    motor.add(J.cwiseQuotient(beta).cwiseProduct(d.wdot));
    motor.add(d.z);
    motor.add(kd2.cwiseQuotient(beta).cwiseProduct(d.nu2));
    spring.add(d.zdot);
    spring.add(-K.cwiseProduct(d.w - d.e1dot));
    spring.add(d.G * d.e1dot);
    spring.add(-kp.cwiseProduct(d.e1dot));
    spring.add(-kd.cwiseProduct(b1).cwiseProduct(d.e1dot));
    spring.add(kd.cwiseProduct(a1).cwiseProduct(d.nu1));
    spring.add(d.n);
    EXPECT_LE(link.sum.norm(), 1e-12 * link.size);
    // J thetaddot_d is a difference of terms up to K |theta - q|.
    EXPECT_LE(motor.sum.norm(), 1e-12 * (motor.size + K.norm()));
    EXPECT_LE(spring.sum.norm(), 1e-12 * spring.size);
  }
}

TEST_P(FlexiblePositionProof, EnergyFallsByDampingAndRisesByTheTermsOfK) {
  robot::testing::Random random(2);
  for (int i = 0; i < 1000; ++i) {
    const Draw d = draw(random);
    const VectorXd K = d.K, beta = d.gains.beta, a1 = d.gains.a1, b1 = d.gains.b1, kp = d.gains.kp1,
                   kd = d.gains.kd1, a2 = d.gains.a2, b2 = d.gains.b2,
                   D2 = VectorXd(d.gains.kd2).cwiseQuotient(beta),
                   Jb = VectorXd(d.J).cwiseQuotient(beta);
    const auto form = [](const VectorXd& x, const VectorXd& k, const VectorXd& y) {
      return x.dot(k.cwiseProduct(y));
    };
    const double energy =
        0.5 * (d.e1dot.dot(d.M * d.e1dot) + form(d.e1, kp, d.e1) +
               form(d.nu1, kd.cwiseQuotient(b1), d.nu1) + form(d.z, K.cwiseInverse(), d.z) +
               form(d.w, Jb, d.w) + form(d.nu2, D2.cwiseQuotient(b2), d.nu2));
    EXPECT_NEAR(d.energy, energy, 1e-12 * energy);
    const double rate[] = {d.e1dot.dot(d.M * d.e1ddot),
                           d.e1dot.dot(d.Mdot * d.e1dot) / 2,
                           form(d.e1, kp, d.e1dot),
                           form(d.nu1, kd.cwiseQuotient(b1), d.nu1dot),
                           form(d.z, K.cwiseInverse(), d.zdot),
                           form(d.w, Jb, d.wdot),
                           form(d.nu2, D2.cwiseQuotient(b2), d.nu2dot)};
    const VectorXd rest = d.G * d.e1dot - (kp + kd.cwiseProduct(b1)).cwiseProduct(d.e1dot) +
                          kd.cwiseProduct(a1).cwiseProduct(d.nu1) + d.n;
    const double claimed[] = {d.e1dot.dot(d.Cd * d.e1dot),
                              form(d.nu1, kd.cwiseProduct(a1).cwiseQuotient(b1), d.nu1),
                              form(d.nu2, D2.cwiseProduct(a2).cwiseQuotient(b2), d.nu2),
                              form(d.z, K.cwiseInverse(), rest)};
    double sum = 0, size = 0;
    for (const double term : rate) sum += term, size += std::abs(term);
    for (const double term : claimed) sum += term, size += std::abs(term);
    EXPECT_NEAR(sum, 0, 1e-11 * size);
  }
}

/// The proof scales (z, w, nu2) to chi, which obeys chidot = Omega F chi less a coupling.
TEST_P(FlexiblePositionProof, ScaledTorqueLoopIsOmegaF) {
  robot::testing::Random random(3);
  const double alpha = 2, zeta = 0.5, s = std::sqrt(2 * zeta * alpha);
  MatrixXd F(3, 3);
  F << 0, 1, 0, -1, 0, -s, 0, s, -alpha;
  EXPECT_LT(F.eigenvalues().real().maxCoeff(), -0.1) << "Hurwitz";
  for (int i = 0; i < 1000; ++i) {
    const Draw d = draw(random);
    const VectorXd K = d.K, Jb = VectorXd(d.J).cwiseQuotient(d.gains.beta);
    const VectorXd omega = K.cwiseQuotient(Jb).cwiseSqrt();
    // The motor filter and damping of the theorem, each joint with an Omega of its own.
    const VectorXd a2 = alpha * omega, D2 = 2 * zeta * Jb.cwiseProduct(omega);
    const VectorXd nu2dot = a2.cwiseProduct(d.w - d.nu2);
    const VectorXd wdot = -(d.z + D2.cwiseProduct(d.nu2)).cwiseQuotient(Jb);
    const VectorXd root_K = K.cwiseSqrt(), root_J = Jb.cwiseSqrt(),
                   root_D = D2.cwiseQuotient(a2).cwiseSqrt();
    for (Eigen::Index j = 0; j < K.size(); ++j) {
      const Eigen::Vector3d chi(d.z[j] / root_K[j], root_J[j] * d.w[j], root_D[j] * d.nu2[j]);
      const double coupling = (d.zdot[j] - K[j] * d.w[j]) / root_K[j];
      const Eigen::Vector3d chidot(d.zdot[j] / root_K[j], root_J[j] * wdot[j],
                                   root_D[j] * nu2dot[j]);
      const Eigen::Vector3d claimed = omega[j] * (F * chi) + coupling * Eigen::Vector3d::UnitX();
      EXPECT_LE((chidot - claimed).norm(),
                1e-12 * (chidot.norm() + omega[j] * chi.norm() + std::abs(coupling)));
    }
  }
}

/// The links' V of the rigid law gains the power (edot + delta)' z and nothing else.
TEST_P(FlexiblePositionProof, TorqueErrorEntersTheRigidProofByItsPassiveOutput) {
  robot::testing::Random random(4);
  for (int i = 0; i < 1000; ++i) {
    const Draw d = draw(random);
    const Eigen::Index joints = d.links.num_joints;
    const VectorXd eps_1 = VectorXd(random.vector(joints, 10)).cwiseAbs(),
                   eps_2 = VectorXd(random.vector(joints, 0.2)).cwiseAbs();
    const VectorXd delta = eps_1.cwiseProduct(d.e1) - eps_2.cwiseProduct(d.nu1);
    const VectorXd deltadot = eps_1.cwiseProduct(d.e1dot) - eps_2.cwiseProduct(d.nu1dot);
    const VectorXd kp = d.gains.kp1,
                   kd_b = VectorXd(d.gains.kd1).cwiseQuotient(VectorXd(d.gains.b1));
    const auto rate = [&](const VectorXd& e1ddot) {
      return d.e1dot.dot(d.M * e1ddot) + d.e1dot.dot(d.Mdot * d.e1dot) / 2 +
             d.e1.dot(kp.cwiseProduct(d.e1dot)) + d.nu1.dot(kd_b.cwiseProduct(d.nu1dot)) +
             deltadot.dot(d.M * d.e1dot) + delta.dot(d.Mdot * d.e1dot) + delta.dot(d.M * e1ddot);
    };
    const VectorXd rigid = d.e1ddot - d.M.ldlt().solve(d.z);  // as if z were 0
    const double power = (d.e1dot + delta).dot(d.z);
    EXPECT_NEAR(
        rate(d.e1ddot) - rate(rigid), power,
        1e-9 * (std::abs(power) + std::abs(rate(rigid)) + (d.e1dot + delta).norm() * d.z.norm()));
  }
}

/// The start of the torque loop does not contain B1, so that B1 can be raised first and beta then.
TEST(FlexiblePosition, TheStartOfTheTorqueErrorDoesNotDependOnTheLinkFilter) {
  robot::testing::Random random(5);
  const Draw d(robot::testing::two_link(), random);
  FlexiblePosition::Gains fast = d.gains;
  fast.a1 *= 100;
  fast.b1 *= 100;
  const messages::BothPositionsMeasurement measured{d.state.q, d.state.theta};
  const auto first = [&](const FlexiblePosition::Gains& gains) {
    const FlexiblePosition law({d.links, d.K, d.J}, gains, Settings{1e-4});
    return law.step(law.start(measured, d.ref), measured, d.ref).signals.value[4];
  };
  EXPECT_EQ(first(d.gains), first(fast));
}

/// With beta = 1 + Kp2 / K and kp1 + kp2 / beta for kp1 the torque is that of the paper's law, with
/// thetaddot_d for thetaddot_ref and the motor's filter on em.
TEST(FlexiblePosition, IsThePapersLawWithTheMotorsReferenceOfTheReferenceAlone) {
  robot::testing::Random random(6);
  for (int i = 0; i < 200; ++i) {
    const Draw d(robot::testing::iiwa7(), random);
    const Eigen::Index joints = d.links.num_joints;
    const Vector kp2 = random.vector(joints, 500).cwiseAbs();
    FlexiblePosition::Gains gains = d.gains;
    gains.beta = (kp2.cwiseQuotient(d.K).array() + 1).matrix();
    gains.kp1 = d.gains.kp1 + kp2.cwiseQuotient(gains.beta);
    const FlexiblePosition law({d.links, d.K, d.J}, gains, Settings{1e-4});
    const messages::BothPositionsMeasurement measured{d.state.q, d.state.theta};
    const auto step = law.step(law.start(measured, d.ref), measured, d.ref);
    const Vector e1 = step.signals.value[0], nu1 = step.signals.value[1],
                 nu2 = step.signals.value[3];
    const Vector torque = robot::inverse_dynamics(d.links, d.state.q, d.ref.v_ref, d.ref.a_ref) -
                          d.gains.kp1.cwiseProduct(e1) - gains.kd1.cwiseProduct(nu1);
    const Vector theta_ref = d.ref.q_ref + torque.cwiseQuotient(d.K);
    const Vector thetaddot_d = robot::second_derivative(law.motor_reference(d.ref));
    const Vector tau = d.J.cwiseProduct(thetaddot_d) + torque -
                       kp2.cwiseProduct(d.state.theta - theta_ref) - gains.kd2.cwiseProduct(nu2);
    EXPECT_LE((step.command.tau - tau).norm(), 1e-11 * (tau.norm() + d.K.norm()));
  }
}

template <class M>
concept HoldsAVelocity = requires(M m) {
  m.v;
}
|| requires(M m) { m.thetadot; };

TEST(FlexiblePosition, MeasuresPositionsAndNoMore) {
  using Measurement = FlexiblePosition::Measurement;
  static_assert(OutputFeedbackLaw<FlexiblePosition>);
  static_assert(!HoldsAVelocity<Measurement>);
  static_assert(sizeof(Measurement) == 2 * sizeof(Vector));
  static_assert(!messages::measures_velocity(Measurement::suffix));
}

TEST(FlexiblePosition, RestsWhereTheSpringsCarryGravity) {
  robot::testing::Random random(7);
  for (int i = 0; i < 100; ++i) {
    const Draw d(robot::testing::two_link(), random);
    const FlexiblePosition law({d.links, d.K, d.J}, d.gains, Settings{1e-3});
    const Vector zero = Vector::Zero(2);
    const ReferencePoint goal{d.ref.q_ref, zero, zero, zero, zero};
    const Vector g = robot::gravity_torque(d.links, goal.q_ref);
    const messages::BothPositionsMeasurement rest{goal.q_ref, goal.q_ref + g.cwiseQuotient(d.K)};
    const auto step = law.step(law.start(rest, goal), rest, goal);
    EXPECT_LE((step.command.tau - g).norm(), 1e-11 * d.K.norm());
    for (int j = 0; j < 5; ++j) {
      EXPECT_LE(step.signals.value[static_cast<std::size_t>(j)].norm(), 1e-11 * d.K.norm());
    }
  }
}

}  // namespace
}  // namespace tachless::controller::law::flexible_position_test

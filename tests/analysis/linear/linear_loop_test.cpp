#include "linear/linear_loop.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>

#include "controller/law/loria_ortega_flexible.h"
#include "controller/law/loria_ortega_rigid.h"
#include "numerics/decompositions.h"
#include "plant/arm.h"
#include "robot/dynamics.h"
#include "tests/analysis/linear/linear_laws.h"
#include "tests/analysis/linear/loops.h"

namespace tachless::linear {
namespace {

using namespace linear::testing;
using controller::law::Discretisation;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Central differences of smooth functions: 1e-10 of step^2 and of rounding / step.
constexpr double differences = 1e-7;

void expect_near(const MatrixXd& A, const MatrixXd& B, double relative) {
  ASSERT_EQ(A.rows(), B.rows());
  ASSERT_EQ(A.cols(), B.cols());
  EXPECT_LE((A - B).cwiseAbs().maxCoeff(), relative * B.cwiseAbs().maxCoeff());
}

TEST(LinearLoop, RigidPlantIsTheGradientOfForwardDynamics) {
  const robot::Model model = robot::testing::iiwa7();
  robot::testing::Random random(1);
  const messages::ReferencePoint p{
      random.vector(7, 1), random.vector(7, 1), random.vector(7, 1), {}, {}};
  const Vector tau = robot::inverse_dynamics(model, p.q_ref, p.v_ref, p.a_ref);
  const LinearPlant plant = rigid_plant(model, p);
  const double h = 1e-6;
  MatrixXd A = MatrixXd::Zero(14, 14);
  A.topRightCorner(7, 7).setIdentity();
  for (int j = 0; j < 14; ++j) {
    const auto at = [&](double s) {
      Vector q = p.q_ref, v = p.v_ref;
      (j < 7 ? q[j] : v[j - 7]) += s;
      return robot::forward_dynamics(model, q, v, tau);
    };
    A.col(j).tail(7) = (at(h) - at(-h)) / (2 * h);
  }
  expect_near(plant.A, A, differences);
}

TEST(LinearLoop, HeldPlantSolvesTheEquationOfMotion) {
  const LinearPlant plant = flexible_plant(
      robot::testing::two_link(), constant_reference(both(0.3, 0.5)), stiffness(), rotors());
  const double h = 2e-3;
  const LinearPlant step = held(plant, h);
  VectorXd x = VectorXd::LinSpaced(8, -1, 1);
  const VectorXd tau = both(3, -2), expected = step.A * x + step.B * tau;
  const int steps = 2000;  // of the midpoint rule, order 2: h^2 |A|^2 / 6 = 1e-7
  const MatrixXd I = MatrixXd::Identity(8, 8);
  const Eigen::PartialPivLU<MatrixXd> lu(I - h / steps / 2 * plant.A);
  for (int k = 0; k < steps; ++k) {
    x = lu.solve((I + h / steps / 2 * plant.A) * x + h / steps * (plant.B * tau)).eval();
  }
  expect_near(expected, x, 1e-6);
}

/// The arm of the plant, moved a little from rest: what it does in 2 ms beside what it does from
/// rest is the map of the linear plant.
TEST(LinearLoop, FlexiblePlantWithDampedSpringsMovesAsTheArm) {
  const robot::Model model = robot::testing::two_link();
  plant::FlexibleDrive drive{stiffness(), rotors(), Vector(both(0.3, 0.2)), {}, Vector(both(8, 5))};
  const Vector q = both(0.3, 0.5);
  const LinearPlant linear =
      held(flexible_plant(model, constant_reference(q), drive.stiffness, drive.rotor_inertia,
                          drive.motor_damping, drive.spring_damping),
           2e-3);
  const Vector hold = robot::gravity_torque(model, q), none = Vector::Zero(2);
  const auto after = [&](const VectorXd& x, const Vector& tau) {
    const Vector theta = q + hold.cwiseQuotient(drive.stiffness);
    plant::ArmOptions options;
    options.accuracy = 1e-13;
    options.mechanics = plant::Mechanics::native;
    options.flexible = &drive;
    plant::Arm arm(
        model, options,
        {q + Vector(x.head(2)), x.segment(2, 2), theta + Vector(x.segment(4, 2)), x.segment(6, 2)});
    arm.advance(hold + tau, 2e-3);
    const plant::ArmState end = arm.state();
    VectorXd all(8);
    all << end.q - q, end.v, end.theta - theta, end.thetadot;
    return all;
  };
  constexpr double by = 1e-5;
  MatrixXd A(8, 8), B(8, 2);
  for (int j = 0; j < 8; ++j) {
    const VectorXd d = by * VectorXd::Unit(8, j);
    A.col(j) = (after(d, none) - after(-d, none)) / (2 * by);
  }
  for (int j = 0; j < 2; ++j) {
    const Vector d = by * Vector::Unit(2, j);
    B.col(j) = (after(VectorXd::Zero(8), d) - after(VectorXd::Zero(8), -d)) / (2 * by);
  }
  expect_near(linear.A, A, differences);
  // Torques of 1e-5 N m move the arm by 1e-10 rad: rounding of q over that, 1e-6.
  expect_near(linear.B, B, 1e-5);
  // The modes of the springs: exp(-D_s / (2 J) 2 ms) = 0.92 for the first joint.
  EXPECT_LT(numerics::eigenvalues(linear.A).cwiseAbs().minCoeff(), 0.95);
}

/// The law itself as a function of vectors.
template <class L>
controller::law::LawStep as_step(const L& law, const messages::ReferencePoint& reference);

template <>
controller::law::LawStep as_step(const controller::law::LoriaOrtegaRigid& law,
                                 const messages::ReferencePoint& reference) {
  return [=](const VectorXd& memory, const VectorXd& y) {
    const controller::law::LoriaOrtegaRigid::Memory before{memory.head(2), memory.tail(2)};
    const auto step = law.step(before, {y}, reference);
    VectorXd after(4);
    after << step.memory.nu, step.memory.e_previous;
    return std::pair<VectorXd, VectorXd>(after, step.command.tau);
  };
}
template <>
controller::law::LawStep as_step(const controller::law::LoriaOrtegaFlexible& law,
                                 const messages::ReferencePoint& reference) {
  return [=](const VectorXd& memory, const VectorXd& y) {
    const controller::law::LoriaOrtegaFlexible::Memory before{
        {memory.segment(0, 2), memory.segment(2, 2)}, {memory.segment(4, 2), memory.segment(6, 2)}};
    const auto step =
        law.step(before, {y.segment(0, 2), y.segment(2, 2), y.segment(4, 2)}, reference);
    VectorXd after(8);
    after << step.memory.link.nu, step.memory.link.e_previous, step.memory.motor.nu,
        step.memory.motor.e_previous;
    return std::pair<VectorXd, VectorXd>(after, step.command.tau);
  };
}

/// The law's frequency response, which does not depend on how its memory is written.
Eigen::MatrixXcd response(const LinearLaw& law, double angle) {
  Eigen::MatrixXcd resolvent = -law.A.cast<std::complex<double>>();
  resolvent.diagonal().array() += std::polar(1.0, angle);
  const Eigen::MatrixXcd B = law.B.cast<std::complex<double>>();
  const Eigen::MatrixXcd state = resolvent.partialPivLu().solve(B);
  return law.C.cast<std::complex<double>>() * state + law.D.cast<std::complex<double>>();
}
void expect_same_response(const LinearLaw& a, const LinearLaw& b) {
  for (const double angle : {0.01, 0.3, 2.0, 3.1}) {
    const Eigen::MatrixXcd A = response(a, angle), B = response(b, angle);
    EXPECT_LE((A - B).cwiseAbs().maxCoeff(), differences * B.cwiseAbs().maxCoeff()) << angle;
  }
}

TEST(LinearLoop, LawOneIsTheGradientOfTheLawItselfAboutAMotion) {
  const robot::Model model = robot::testing::two_link();
  const messages::ReferencePoint p{both(0.3, -0.8), both(1, -0.5), both(2, 3), both(0), both(0)};
  for (const Discretisation kind : {Discretisation::tustin, Discretisation::zero_order_hold}) {
    controller::law::Settings settings;
    settings.filter = kind;
    const controller::law::FilterGains g = practical_rigid();
    const controller::law::LoriaOrtegaRigid law(model, {g.kp, g.kd, g.a, g.b}, settings);
    VectorXd memory(4);
    memory << 0, 0, 0, 0;
    expect_same_response(linear_rigid_law(g, gradient_by_q(model, p), {kind, settings.period_s}),
                         linearised(as_step(law, p), memory, p.q_ref, {Part::q}));
  }
}

TEST(LinearLoop, LawTwoIsTheGradientOfTheLawItselfAtRest) {
  const robot::Model model = robot::testing::two_link();
  const Vector q = both(0.4, -0.7);
  controller::law::Settings settings;
  settings.filter = Discretisation::tustin;
  const controller::law::FilterGains l = practical_link(), m = practical_motor();
  const controller::law::LoriaOrtegaFlexible law(
      {model, stiffness(), rotors()}, {l.kp, l.kd, l.a, l.b, m.kp, m.kd, m.a, m.b}, settings);
  VectorXd y(6);
  y << q, 0, 0, q + robot::gravity_torque(model, q).cwiseQuotient(stiffness());
  expect_same_response(linear_flexible_law(model, q, stiffness(), rotors(), l, m,
                                           {settings.filter, settings.period_s}),
                       linearised(as_step(law, constant_reference(q)), VectorXd::Zero(8), y,
                                  {Part::q, Part::v, Part::theta}));
}

TEST(LinearLoop, PeriodMapDelaysTheTorqueByWholePeriods) {
  const robot::Model model = robot::testing::two_link();
  const LinearPlant plant = rigid_plant(model, constant_reference(both(0)));
  const controller::law::FilterGains g = practical_rigid();
  const LinearLaw law = linear_rigid_law(g, gradient_by_q(model, constant_reference(both(0))), {});
  const double h = 1e-3;
  const LinearPlant step = held(plant, h);
  for (int delay = 0; delay <= 3; ++delay) {
    VectorXd x = VectorXd::LinSpaced(4, 0.1, 0.4), s = VectorXd::Zero(2);
    std::vector<VectorXd> torque(static_cast<std::size_t>(delay), VectorXd::Zero(2));
    const MatrixXd map = cut(plant, law, h, delay).closed();
    VectorXd z = VectorXd::Zero(map.rows());
    z.head(4) = x;
    for (int k = 0; k < 6; ++k) {
      torque.push_back(law.C * s + law.D * x.head(2));
      s = (law.A * s + law.B * x.head(2)).eval();
      x = (step.A * x + step.B * torque[static_cast<std::size_t>(k)]).eval();
      z = (map * z).eval();
    }
    expect_near(z.head(4), x, 1e-9);
  }
}

TEST(LinearLoop, GainMultipliesTheFeedbackTermsAlone) {
  const robot::Model model = robot::testing::iiwa7();
  const messages::ReferencePoint rest = constant_reference(robot::testing::Random(5).vector(7, 1));
  const LinearPlant plant = rigid_plant(model, rest);
  const MatrixXd gravity = gradient_by_q(model, rest);
  const Sampling sampling{Discretisation::tustin, 1e-3};
  controller::law::FilterGains gains = iiwa_gains();
  const LinearLaw law = linear_rigid_law(gains, gravity, sampling);
  gains.kp *= 1.5;
  gains.kd *= 1.5;
  const LinearLaw harder = linear_rigid_law(gains, gravity, sampling);
  for (const int delay : {0, 1, 3}) {
    // The same sums in another order.
    expect_near(cut(plant, law, 1e-3, delay).closed(1.5), cut(plant, harder, 1e-3, delay).closed(),
                1e-14);
  }
}

TEST(Edge, IsFoundByHalvesOfTheDistanceOrOfItsLogarithm) {
  const auto below = [](double x) { return x < 0.03; };
  // After k halvings, the ends differ by the first distance, or logarithm, over 2^k.
  EXPECT_NEAR(edge(1e-6, 1, 30, below), 0.03, std::ldexp(1, -30));
  EXPECT_NEAR(std::log(edge(1e-6, 1, 10, below, Middle::geometric) / 0.03), 0,
              std::log(1e6) * std::ldexp(1, -10));
  EXPECT_TRUE(below(edge(1e-6, 1, 10, below, Middle::geometric)));
  EXPECT_EQ(edge(1e-6, 1, 1, below, Middle::geometric), 1e-3);
  const auto above = [](double x) { return x > 0.03; };
  EXPECT_NEAR(edge(1, 1e-6, 30, above), 0.03, std::ldexp(1, -30));
}

}  // namespace
}  // namespace tachless::linear

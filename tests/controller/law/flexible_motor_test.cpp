#include "controller/law/flexible_motor.h"

#include <gtest/gtest.h>

#include "controller/law/rivals/kelly_flexible.h"
#include "tests/core/robot/robots.h"

namespace tachless::controller::law::flexible_motor_test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// The links obey M e1ddot + [C(q, v) + Cd] e1dot + K (e1 - em) + H e1 = 0, with H e1 the change of
/// ID_l from q_ref to q, and the motors J emddot + K (em - e1) + Kp em + Kd nu = 0.
void expect_error_equation(const robot::Model& links, unsigned seed) {
  robot::testing::Random random(seed);
  const Eigen::Index n = links.num_joints;
  const auto positive = [&](double most) -> Vector {
    return (random.vector(n, most).cwiseAbs().array() + 0.05 * most).matrix();
  };
  for (int i = 0; i < 500; ++i) {
    const Vector K = positive(2e4), J = positive(1);
    const FilterGains gains{positive(2e3), positive(60), positive(1000), positive(1000)};
    const FlexibleMotor law({links, K, J}, gains, Settings{1e-4});
    const ReferencePoint ref{random.vector(n, 2), random.vector(n, 2), random.vector(n, 20),
                             random.vector(n, 100), random.vector(n, 1000)};
    const Vector q = random.vector(n, 3), v = random.vector(n, 3);
    const Vector theta = q + random.vector(n, 0.05);
    const FlexibleMotor::Memory memory{random.vector(n, 5), random.vector(n, 0.1)};
    const auto step = law.step(memory, {theta}, ref);
    const Vector spring = K.cwiseProduct(theta - q);
    const Vector vdot = robot::forward_dynamics(links, q, v, spring);
    const robot::JetVector theta_d = law.motor_reference(ref).theta_d;
    const Vector e1 = q - ref.q_ref, em = step.signals.value[0], nu = step.signals.value[1];
    const Vector emddot =
        (step.command.tau - spring).cwiseQuotient(J) - robot::second_derivative(theta_d);
    const MatrixXd C =
        robot::coriolis_matrix(links, q, v) + robot::coriolis_matrix(links, q, ref.v_ref);
    const Vector change = robot::inverse_dynamics(links, q, ref.v_ref, ref.a_ref) -
                          robot::inverse_dynamics(links, ref.q_ref, ref.v_ref, ref.a_ref);
    const VectorXd link[] = {robot::mass_matrix(links, q) * (vdot - ref.a_ref),
                             C * VectorXd(v - ref.v_ref), K.cwiseProduct(e1 - em), change};
    const VectorXd motor[] = {J.cwiseProduct(emddot), K.cwiseProduct(em - e1),
                              gains.kp.cwiseProduct(em), gains.kd.cwiseProduct(nu)};
    const auto expect_balance = [&](const VectorXd(&terms)[4]) {
      VectorXd sum = VectorXd::Zero(n);
      double size = K.norm();  // theta_d is a sum of angles up to some rad
      for (const VectorXd& term : terms) {
        sum += term;
        size += term.norm();
      }
      EXPECT_LE(sum.norm(), 1e-12 * size);
    };
    expect_balance(link);
    expect_balance(motor);
  }
}

TEST(FlexibleMotor, ClosedLoopIsTheErrorEquationOfTwoJoints) {
  expect_error_equation(robot::testing::two_link(), 1);
}
TEST(FlexibleMotor, ClosedLoopIsTheErrorEquationOfSevenJoints) {
  expect_error_equation(robot::testing::iiwa7(), 2);
}

TEST(FlexibleMotor, IsKellysLawAtAConstantReference) {
  robot::testing::Random random(3);
  const Vector K = Vector::Constant(2, 1e4), J = Vector::Constant(2, 0.1), zero = Vector::Zero(2);
  const FilterGains gains{Vector::Constant(2, 1e3), Vector::Constant(2, 50),
                          Vector::Constant(2, 800), Vector::Constant(2, 800)};
  const FlexibleRobot robot{robot::testing::two_link(), K, J};
  const FlexibleMotor law(robot, gains, Settings{1e-3});
  const KellyFlexible kelly(robot, gains, Settings{1e-3});
  for (int i = 0; i < 100; ++i) {
    const ReferencePoint goal{random.vector(2, 3), zero, zero, zero, zero};
    const messages::MotorPositionMeasurement measured{random.vector(2, 3)};
    const Filter::Memory memory{random.vector(2, 3), random.vector(2, 3)};
    const Vector expected = kelly.step(memory, measured, goal).command.tau;
    EXPECT_LE((law.step(memory, measured, goal).command.tau - expected).norm(),
              1e-12 * expected.norm());
  }
}

}  // namespace
}  // namespace tachless::controller::law::flexible_motor_test

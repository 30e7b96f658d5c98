#include "plant/stiffness.h"

#include <gtest/gtest.h>

#include <cmath>

#include "robot/mass_matrix.h"
#include "tests/plant/arms.h"

namespace tachless::plant {
namespace {

using robot::Vector;

TEST(FastestRate, IsTheModeOfTwoMassesAndASpring) {
  robot::Matrix M(1, 1);
  M(0, 0) = 2;
  FlexibleDrive drive;
  drive.stiffness = Vector::Constant(1, 1e4);
  drive.rotor_inertia = Vector::Constant(1, 0.5);
  // sqrt(K (1/M + 1/J)); eigenvalues to rounding of a 4 x 4 problem.
  EXPECT_NEAR(fastest_rate(M, &drive, {}), std::sqrt(1e4 * 2.5), 1e-9);
}

TEST(FastestRate, IsFrictionOverInertiaOfARigidJoint) {
  robot::Matrix M(1, 1);
  M(0, 0) = 2;
  EXPECT_NEAR(fastest_rate(M, nullptr, Vector::Constant(1, 30)), 15, 1e-12);  // rounding
  EXPECT_EQ(fastest_rate(M, nullptr, {}), 0);
}

TEST(IntegratorSteps, AreAtLeastOne) {
  EXPECT_EQ(integrator_steps(Integrator::runge_kutta_merson, 0, 1e-3), 1);
  EXPECT_EQ(integrator_steps(Integrator::cpodes, 1e9, 1), 1);
}

class StiffArm : public ::testing::TestWithParam<Integrator> {};

// What an integrator does at a modest accuracy is stability alone: between the estimate and three
// times it.
TEST_P(StiffArm, TakesAsManyStepsAsEstimated) {
  const robot::Model model = robot::testing::two_link();
  FlexibleDrive drive;
  drive.stiffness = Vector::Constant(2, 1e9);
  drive.rotor_inertia = Vector::Constant(2, 0.1);
  ArmOptions options;
  options.flexible = &drive;
  options.integrator = GetParam();
  options.accuracy = 1e-3;
  ArmState initial;
  initial.q = initial.theta = Eigen::Vector2d(0.1, 0.2);
  initial.v = initial.thetadot = Vector::Zero(2);
  const double rate = fastest_rate(robot::mass_matrix<double>(model, initial.q), &drive, {});
  const double estimate = integrator_steps(GetParam(), rate, 1e-2);
  ASSERT_GT(estimate, 100);
  Arm arm(model, options, initial);
  arm.advance(Eigen::Vector2d(20, 3), 1e-2);
  const auto before = arm.integrator_steps();
  arm.advance(Eigen::Vector2d(-20, 3), 2e-2);
  const auto taken = static_cast<double>(arm.integrator_steps() - before);
  EXPECT_GT(taken, 0.9 * estimate);
  EXPECT_LT(taken, 3 * estimate);
}

INSTANTIATE_TEST_SUITE_P(, StiffArm,
                         ::testing::Values(Integrator::runge_kutta_merson,
                                           Integrator::runge_kutta_3,
                                           Integrator::runge_kutta_feldberg,
                                           Integrator::semi_explicit_euler_2, Integrator::verlet));

}  // namespace
}  // namespace tachless::plant

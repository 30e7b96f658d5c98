#include "plant/arm.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "robot/dynamics.h"
#include "tests/plant/arms.h"

namespace tachless::plant {
namespace {

using robot::Vector;
using ::testing::HasSubstr;
using testing::Random;
using testing::rigid_state;

/// Largest |Simbody's acceleration - forward dynamics of robot/| over random states, each relative
/// to the acceleration's norm.
double worst_acceleration_difference(const robot::Model& model, unsigned seed) {
  Random random(seed);
  double worst = 0;
  for (int k = 0; k < 50; ++k) {
    const Vector q = random.vector(model.num_joints, 3), v = random.vector(model.num_joints, 2);
    const Vector tau = random.vector(model.num_joints, 50);
    const Arm arm(model, {}, rigid_state(q, v));
    const Vector expected = robot::forward_dynamics<double>(model, q, v, tau);
    const Vector difference = arm.acceleration(tau).vdot - expected;
    worst = std::max(worst, difference.norm() / expected.norm());
  }
  return worst;
}

// Two independent implementations of one linear solve: the difference is a small multiple of
// cond(M) eps, and cond(M) is 20 for the two-link arm, some hundreds for the random robots.
TEST(Arm, AcceleratesAsTheTwoLinkArmDoes) {
  EXPECT_LT(worst_acceleration_difference(robot::testing::two_link(), 1), 1e-12);
}
TEST(Arm, AcceleratesAsTheTwoLinkArmWithPayloadDoes) {
  EXPECT_LT(worst_acceleration_difference(robot::testing::two_link(0.5), 2), 1e-12);
}
TEST(Arm, AcceleratesAsASpatialChainDoes) {
  EXPECT_LT(worst_acceleration_difference(testing::random_chain(), 3), 1e-11);
}
TEST(Arm, AcceleratesAsATreeWithPrismaticAndMimicJointsDoes) {
  EXPECT_LT(worst_acceleration_difference(testing::random_tree(), 4), 1e-11);
}
TEST(Arm, AcceleratesAsASevenJointArmDoes) {
  EXPECT_LT(worst_acceleration_difference(robot::testing::iiwa7(), 5), 1e-11);
}

TEST(Arm, HasTheInertiaMatrixOfTheClosedForm) {
  for (const double payload : {0.0, 0.5}) {
    const robot::Model model = robot::testing::two_link(payload);
    const robot::testing::TwoLinkClosedForm closed{payload};
    const Vector q = Eigen::Vector2d(0.4, -1.1);
    const Arm arm(model, {}, rigid_state(q, Vector::Zero(2)));
    const Vector zero = Vector::Zero(2);
    const Vector at_rest = arm.acceleration(zero).vdot;
    robot::Matrix M_inverse(2, 2);
    for (int j = 0; j < 2; ++j) {
      M_inverse.col(j) = arm.acceleration(Vector(Vector::Unit(2, j))).vdot - at_rest;
    }
    // Rounding: |M| |M^-1| eps with |a| about 10.
    EXPECT_LT((closed.M<double>(q) * M_inverse - robot::Matrix::Identity(2, 2)).norm(), 1e-12);
  }
}

TEST(Arm, AddsRotorInertiaToTheDiagonalExactly) {
  robot::Model model = robot::testing::two_link();
  const Vector q = Eigen::Vector2d(0.2, 0.9), v = Eigen::Vector2d(-1, 0.5);
  const Vector tau = Eigen::Vector2d(3, -4);
  model.rotor_inertia = Eigen::Vector2d(0.1, 0.2);
  const robot::testing::TwoLinkClosedForm closed;
  robot::Matrix M = closed.M<double>(q);
  M.diagonal() += model.rotor_inertia;
  const Vector vdot = Arm(model, {}, rigid_state(q, v)).acceleration(tau).vdot;
  const Vector left = M * vdot + closed.C<double>(q, v) * v + closed.g<double>(q);
  EXPECT_LT((left - tau).norm(), 1e-12 * (M * vdot).norm());  // rounding
}

TEST(Arm, KeepsTheInertiaOfAMasslessBody) {
  robot::Model model = robot::testing::two_link();
  const Vector q = Eigen::Vector2d(0.2, 0.9), v = Eigen::Vector2d(-1, 0.5);
  robot::Body disc;
  disc.parent = 0;
  disc.coordinate = 1;
  disc.axis_B = model.bodies[1].axis_B;
  disc.multiplier = 3;
  disc.I_Bcm = 0.2 * Eigen::Matrix3d::Identity();
  model.bodies.push_back(disc);
  const Vector tau = Eigen::Vector2d(3, -4);
  const Vector expected = robot::forward_dynamics<double>(model, q, v, tau);
  const Vector without = robot::forward_dynamics<double>(robot::testing::two_link(), q, v, tau);
  ASSERT_GT((expected - without).norm(), 0.1 * expected.norm());
  EXPECT_LT((Arm(model, {}, rigid_state(q, v)).acceleration(tau).vdot - expected).norm(),
            1e-12 * expected.norm());  // rounding
}

struct Torques {
  explicit Torques(int joints, double bound) : joints_(joints), bound_(bound) {}
  Vector next() { return random_.vector(joints_, bound_); }

 private:
  Random random_{5};
  int joints_;
  double bound_;
};

/// The tree's distance from an independent integration after 100 ticks of 1 ms under torques that
/// jump, in positions [rad; m] and velocities.
std::pair<double, double> distance_after_jumps(Integrator method, double accuracy) {
  const robot::Model model = testing::random_tree();
  const int n = model.num_joints;
  Random random(6);
  const Vector q = random.vector(n, 1), v = random.vector(n, 1);
  ArmOptions options;
  options.integrator.method = method;
  options.integrator.accuracy = accuracy;
  Arm arm(model, options, rigid_state(q, v));
  Eigen::VectorXd y(2 * n);
  y << q, v;
  Torques torques(n, 20);
  for (int k = 0; k < 100; ++k) {
    const Vector tau = torques.next();
    arm.advance(tau, (k + 1) * 1e-3);
    y = testing::runge_kutta_4(
        [&](const Eigen::VectorXd& state) {
          Eigen::VectorXd rate(2 * n);
          rate << state.tail(n), robot::forward_dynamics<double>(model, Vector(state.head(n)),
                                                                 Vector(state.tail(n)), tau);
          return rate;
        },
        y, 1e-3, 20);
  }
  return {(arm.state().q - y.head(n)).norm(), (arm.state().v - y.tail(n)).norm()};
}

TEST(Arm, HoldsATorqueThatJumpsEveryTick) {
  const auto [q, v] = distance_after_jumps(Integrator::runge_kutta_merson, 1e-12);
  // Accuracy 1e-12 a step over 100 steps; the Runge-Kutta steps of 50 us err by 1e-14 each.
  EXPECT_LT(q, 1e-10);
  EXPECT_LT(v, 1e-9);
}

FlexibleDrive two_link_drive() {
  FlexibleDrive drive;
  drive.stiffness = Eigen::Vector2d(1e4, 8e3);
  drive.rotor_inertia = Eigen::Vector2d(0.1, 0.12);
  drive.motor_damping = Eigen::Vector2d(0.3, 0.2);
  return drive;
}

TEST(Arm, FollowsTheFlexibleEquationsOfThePaper) {
  const robot::Model model = robot::testing::two_link(0.5);
  const robot::testing::TwoLinkClosedForm closed{0.5};
  const FlexibleDrive drive = two_link_drive();
  ArmOptions options;
  options.flexible = &drive;
  options.drive.viscous_friction_Nms_per_rad = Eigen::Vector2d(0.7, 0.4);
  options.integrator.accuracy = 1e-12;
  ArmState initial;
  initial.q = Eigen::Vector2d(0.3, -0.2);
  initial.v = Eigen::Vector2d(1, -1);
  initial.theta = Eigen::Vector2d(0.305, -0.201);
  initial.thetadot = Eigen::Vector2d(0.5, 0.2);
  Arm arm(model, options, initial);
  Eigen::VectorXd y(8);
  y << initial.q, initial.theta, initial.v, initial.thetadot;
  Torques torques(2, 30);
  for (int k = 0; k < 200; ++k) {
    const Vector tau = torques.next();
    arm.advance(tau, (k + 1) * 1e-3);
    // Paper, eq. 1, with friction.
    y = testing::runge_kutta_4(
        [&](const Eigen::VectorXd& state) {
          const Vector q = state.segment(0, 2), theta = state.segment(2, 2);
          const Vector v = state.segment(4, 2), thetadot = state.segment(6, 2);
          const Vector spring = drive.stiffness.cwiseProduct(theta - q);
          const Vector vdot = closed.M<double>(q).inverse() *
                              (spring - closed.C<double>(q, v) * v - closed.g<double>(q) -
                               options.drive.viscous_friction_Nms_per_rad.cwiseProduct(v));
          const Vector thetaddot = (tau - spring - drive.motor_damping.cwiseProduct(thetadot))
                                       .cwiseQuotient(drive.rotor_inertia);
          Eigen::VectorXd rate(8);
          rate << v, thetadot, vdot, thetaddot;
          return rate;
        },
        y, 1e-3, 40);
  }
  // Accuracy 1e-12 a step on modes of 400 rad/s; the Runge-Kutta steps of 25 us err by less.
  EXPECT_LT((arm.state().q - y.segment(0, 2)).norm(), 1e-10);
  EXPECT_LT((arm.state().theta - y.segment(2, 2)).norm(), 1e-10);
  EXPECT_LT((arm.state().v - y.segment(4, 2)).norm(), 1e-8);
  EXPECT_LT((arm.state().thetadot - y.segment(6, 2)).norm(), 1e-8);
}

TEST(Arm, ConservesEnergy) {
  const robot::Model model = testing::random_tree();
  Random random(8);
  const auto energy = [&](const ArmState& state) {
    return robot::kinetic_energy<double>(model, state.q, state.v) +
           robot::potential_energy<double>(model, state.q);
  };
  ArmOptions options;
  options.integrator.accuracy = 1e-11;
  Arm arm(model, options, rigid_state(random.vector(5, 1), random.vector(5, 2)));
  const double before = energy(arm.state());
  const Vector q = arm.state().q;
  arm.advance(Vector::Zero(5), 2);
  ASSERT_GT((arm.state().q - q).norm(), 0.5);  // it moved
  // Some thousand steps of accuracy 1e-11 on energies of about 100 J.
  EXPECT_NEAR(energy(arm.state()), before, 1e-6);
}

class EveryIntegrator : public ::testing::TestWithParam<Integrator> {};

TEST_P(EveryIntegrator, ConvergesWithAccuracy) {
  const robot::Model model = robot::testing::two_link();
  const ArmState initial = rigid_state(Eigen::Vector2d(1, -0.5), Eigen::Vector2d(2, 1));
  const auto end = [&](Integrator method, double accuracy) {
    ArmOptions options;
    options.integrator.method = method;
    options.integrator.accuracy = accuracy;
    Arm arm(model, options, initial);
    arm.advance(Eigen::Vector2d(3, 1), 0.25);
    arm.advance(Eigen::Vector2d(-3, 1), 0.5);
    return arm.state().q;
  };
  const Vector exact = end(Integrator::runge_kutta_feldberg, 1e-12);
  const double coarse = (end(GetParam(), 1e-3) - exact).norm();
  const double fine = (end(GetParam(), 1e-6) - exact).norm();
  // The accuracy bounds the error of a step. A thousandfold finer, a method of order p with error
  // control of order p is 10^(3 p / (p + 1)) better overall: at least 30 from order 1 on.
  EXPECT_LT(fine, coarse / 20);
  EXPECT_LT(fine, 1e-3);
}

TEST_P(EveryIntegrator, HoldsATorqueThatJumpsEveryTick) {
  // A hundred ticks with an error of 1e-6 a step or less; a derivative of the old torque in one new
  // step would alone make 1e-2 in velocity.
  const auto [q, v] = distance_after_jumps(GetParam(), 1e-6);
  EXPECT_LT(q, 1e-4);
  EXPECT_LT(v, 1e-3);
}

TEST_P(EveryIntegrator, GivesTheSameBitsForTheSameCalls) {
  const robot::Model model = robot::testing::two_link();
  const FlexibleDrive drive = two_link_drive();
  ArmOptions options;
  options.flexible = &drive;
  options.integrator.method = GetParam();
  options.integrator.accuracy = 1e-5;
  ArmState initial;
  initial.q = initial.theta = Eigen::Vector2d(0.3, -0.2);
  initial.v = initial.thetadot = Eigen::Vector2d(1, -1);
  const auto run = [&](bool disturbed) {
    Arm arm(model, options, initial);
    Torques torques(2, 30);
    for (int k = 0; k < 50; ++k) {
      if (disturbed) {  // another arm lives, moves and dies, and this one is asked questions
        Arm other(model, options, initial);
        other.advance(Vector::Constant(2, k), 1e-4);
        (void)arm.acceleration(Vector::Constant(2, k));
      }
      arm.advance(torques.next(), (k + 1) * 1e-3);
    }
    return arm.state();
  };
  const ArmState once = run(false), again = run(true);
  const auto same_bits = [](const Vector& a, const Vector& b) {
    return std::memcmp(a.data(), b.data(), sizeof(double) * static_cast<std::size_t>(a.size())) ==
           0;
  };
  EXPECT_TRUE(same_bits(once.q, again.q));
  EXPECT_TRUE(same_bits(once.v, again.v));
  EXPECT_TRUE(same_bits(once.theta, again.theta));
  EXPECT_TRUE(same_bits(once.thetadot, again.thetadot));
}

INSTANTIATE_TEST_SUITE_P(, EveryIntegrator,
                         ::testing::Values(Integrator::runge_kutta_merson,
                                           Integrator::runge_kutta_3,
                                           Integrator::runge_kutta_feldberg,
                                           Integrator::semi_explicit_euler_2, Integrator::verlet,
                                           Integrator::cpodes));

TEST(Arm, IsNotDisturbedByArmsInOtherThreads) {
  const robot::Model model = testing::random_tree();
  const auto run = [&] {
    Arm arm(model, {}, rigid_state(Vector::Constant(5, 0.2), Vector::Constant(5, -0.3)));
    Torques torques(5, 20);
    for (int k = 0; k < 100; ++k) arm.advance(torques.next(), (k + 1) * 1e-3);
    return arm.state().q;
  };
  const Vector alone = run();
  Vector together[4];
  std::vector<std::thread> threads;
  for (Vector& q : together) threads.emplace_back([&] { q = run(); });
  for (std::thread& thread : threads) thread.join();
  for (const Vector& q : together) EXPECT_EQ(q, alone);
}

TEST(Arm, BrakesToRest) {
  robot::Model model = robot::testing::two_link();
  model.gravity.setZero();
  Arm arm(model, {}, rigid_state(Eigen::Vector2d(0, 1), Eigen::Vector2d(3, -2)));
  arm.advance(Vector::Zero(2), 0.1);
  ASSERT_GT(arm.state().v.norm(), 1);
  arm.brake(Eigen::Vector2d(100, 10));
  arm.advance(Vector::Zero(2), 3.1);
  EXPECT_LT(arm.state().v.norm(), 1e-6);  // 3 s are tens of time constants M / d
}

TEST(Arm, BrakesTheMotorsOfAFlexibleRobot) {
  robot::Model model = robot::testing::two_link();
  model.gravity.setZero();
  const FlexibleDrive drive = two_link_drive();
  ArmOptions options;
  options.flexible = &drive;
  ArmState initial;
  initial.q = initial.theta = Eigen::Vector2d(0, 1);
  initial.v = initial.thetadot = Eigen::Vector2d(3, -2);
  Arm arm(model, options, initial);
  const Vector before = arm.acceleration(Vector::Zero(2)).thetaddot;
  arm.brake(Eigen::Vector2d(5, 6));
  const Vector change = arm.acceleration(Vector::Zero(2)).thetaddot - before;
  EXPECT_NEAR(change[0], -5 * 3 / 0.1, 1e-9);  // identity, up to rounding
  EXPECT_NEAR(change[1], 6 * 2 / 0.12, 1e-9);
}

TEST(Arm, EndsExactlyAtTheTimeAskedFor) {
  const robot::Model model = robot::testing::two_link();
  Arm arm(model, {}, rigid_state(Vector::Zero(2), Vector::Zero(2)));
  arm.advance(Vector::Zero(2), 0.1);
  EXPECT_THROW(arm.advance(Vector::Zero(2), 0.1), std::logic_error);
  EXPECT_NO_THROW(arm.advance(Vector::Zero(2), std::nextafter(0.1, 1.0) + 1e-9));
}

TEST(Arm, NamesTimeCauseAndRemedyWhenItCannotGoOn) {
  const robot::Model model = robot::testing::two_link();
  Arm arm(model, {}, rigid_state(Vector::Zero(2), Vector::Zero(2)));
  arm.advance(Vector::Zero(2), 0.25);
  try {
    arm.advance(Vector::Constant(2, 1e200), 0.5);
    FAIL() << "integrated a torque of 1e200 N m";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr("t = 0.25 s"));
    EXPECT_THAT(error.what(), HasSubstr("shorten loop.period_s"));
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
  }
}

TEST(Arm, RefusesAWrongNumberOfJoints) {
  const robot::Model model = robot::testing::two_link();
  EXPECT_THROW(Arm(model, {}, rigid_state(Vector::Zero(3), Vector::Zero(3))), std::logic_error);
  Arm arm(model, {}, rigid_state(Vector::Zero(2), Vector::Zero(2)));
  EXPECT_THROW(arm.advance(Vector::Zero(3), 1), std::logic_error);
  EXPECT_THROW(arm.brake(Vector::Zero(1)), std::logic_error);
}

}  // namespace
}  // namespace tachless::plant

// The emulated arm, whichever mechanics it has.
#include "plant/arm.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "plant/step_error.h"
#include "robot/dynamics.h"
#include "tests/core/robot/energy.h"
#include "tests/plant/arms.h"
#include "tests/support/counting_new.h"
#include "tests/support/same_bits.h"

namespace tachless::plant {
namespace {

using ::testing::HasSubstr;
using testing::Random;
using testing::rigid_state;

class EveryArm : public ::testing::TestWithParam<Mechanics> {
 protected:
  [[nodiscard]] static ArmOptions options(double accuracy = 1e-9,
                                          const FlexibleDrive* flexible = nullptr) {
    ArmOptions result;
    result.mechanics = GetParam();
    result.accuracy = accuracy;
    result.flexible = flexible;
    return result;
  }
  static Arm arm(const robot::Model& model, const Vector& q, const Vector& v) {
    return Arm(model, options(), rigid_state(q, v));
  }
  static std::unique_ptr<Multibody> multibody(const robot::Model& model) {
    return GetParam() == Mechanics::native ? native_multibody(model) : simbody_multibody(model);
  }
  /// Torques without rotors that this acceleration takes.
  static Vector torque(const robot::Model& model, const Vector& q, const Vector& v,
                       const Vector& vdot) {
    const auto mechanics = multibody(model);
    const Multibody::Terms terms = mechanics->evaluate(q, v);
    return terms.M * vdot + terms.bias;
  }
};

INSTANTIATE_TEST_SUITE_P(, EveryArm, ::testing::Values(Mechanics::simbody, Mechanics::native),
                         testing::name_of_mechanics);

TEST_P(EveryArm, TakesTheTorquesThatForwardDynamicsSays) {
  const std::vector<robot::Model> robots = {robot::testing::two_link(),
                                            robot::testing::two_link(0.5), testing::random_chain(),
                                            testing::random_tree(), robot::testing::iiwa7()};
  Random random(1);
  for (const robot::Model& model : robots) {
    for (int k = 0; k < 50; ++k) {
      const Vector q = random.vector(model.num_joints, 3), v = random.vector(model.num_joints, 2);
      const Vector tau = random.vector(model.num_joints, 50);
      const Vector vdot = robot::forward_dynamics(model, q, v, tau);
      const Vector rotors = model.rotor_inertia.cwiseProduct(vdot);
      // Rounding of M vdot and of the other implementation's solve, whose cond(M) is some hundreds.
      ASSERT_LT((torque(model, q, v, vdot) + rotors - tau).norm(), 1e-11 * tau.norm());
    }
  }
}

TEST_P(EveryArm, HasTheClosedFormsInertiaMatrixAndBias) {
  const Vector q = Eigen::Vector2d(0.2, 0.9), v = Eigen::Vector2d(-1, 0.5);
  for (const double payload : {0.0, 0.5}) {
    const robot::testing::TwoLinkClosedForm closed{payload};
    const auto mechanics = multibody(robot::testing::two_link(payload));
    const Multibody::Terms terms = mechanics->evaluate(q, v);
    const Matrix M = closed.M<double>(q);
    const Vector bias = closed.C<double>(q, v) * v + closed.g<double>(q);
    EXPECT_LT((terms.M - M).norm(), 1e-13 * M.norm());  // rounding
    EXPECT_LT((terms.bias - bias).norm(), 1e-13 * bias.norm());
  }
}

TEST_P(EveryArm, KeepsTheInertiaOfAMasslessBody) {
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
  const Vector expected = robot::forward_dynamics(model, q, v, tau);
  const Vector without = robot::forward_dynamics(robot::testing::two_link(), q, v, tau);
  ASSERT_GT((expected - without).norm(), 0.1 * expected.norm());
  EXPECT_LT((torque(model, q, v, expected) - tau).norm(), 1e-12 * tau.norm());  // rounding
}

struct Torques {
  explicit Torques(int joints, double bound) : joints_(joints), bound_(bound) {}
  Vector next() { return random_.vector(joints_, bound_); }

 private:
  Random random_{5};
  int joints_;
  double bound_;
};

TEST_P(EveryArm, HoldsATorqueThatJumpsEveryTick) {
  const robot::Model model = testing::random_tree();
  const int n = model.num_joints;
  Random random(6);
  const Vector q = random.vector(n, 1), v = random.vector(n, 1);
  Arm arm(model, options(1e-12), rigid_state(q, v));
  Eigen::VectorXd y(2 * n);
  y << q, v;
  Torques torques(n, 20);
  for (int k = 0; k < 100; ++k) {
    const Vector tau = torques.next();
    arm.advance(tau, (k + 1) * 1e-3);
    y = testing::runge_kutta_4(
        [&](const Eigen::VectorXd& state) {
          Eigen::VectorXd rate(2 * n);
          rate << state.tail(n),
              robot::forward_dynamics(model, Vector(state.head(n)), Vector(state.tail(n)), tau);
          return rate;
        },
        y, 1e-3, 20);
  }
  // Accuracy 1e-12 a step over 100 steps; the Runge-Kutta steps of 50 us err by 1e-14 each.
  EXPECT_LT((arm.state().q - y.head(n)).norm(), 1e-10);
  EXPECT_LT((arm.state().v - y.tail(n)).norm(), 1e-9);
}

FlexibleDrive two_link_drive() {
  FlexibleDrive drive;
  drive.stiffness = Eigen::Vector2d(1e4, 8e3);
  drive.rotor_inertia = Eigen::Vector2d(0.1, 0.12);
  drive.motor_damping = Eigen::Vector2d(0.3, 0.2);
  drive.spring_damping = Eigen::Vector2d(5, 3);
  return drive;
}

TEST_P(EveryArm, FollowsTheFlexibleEquationsOfThePaper) {
  const robot::Model model = robot::testing::two_link(0.5);
  const robot::testing::TwoLinkClosedForm closed{0.5};
  const FlexibleDrive drive = two_link_drive();
  ArmOptions with = options(1e-12, &drive);
  with.drive.viscous_friction_Nms_per_rad = Eigen::Vector2d(0.7, 0.4);
  ArmState initial;
  initial.q = Eigen::Vector2d(0.3, -0.2);
  initial.v = Eigen::Vector2d(1, -1);
  initial.theta = Eigen::Vector2d(0.305, -0.201);
  initial.thetadot = Eigen::Vector2d(0.5, 0.2);
  Arm arm(model, with, initial);
  Eigen::VectorXd y(8);
  y << initial.q, initial.theta, initial.v, initial.thetadot;
  Torques torques(2, 30);
  for (int k = 0; k < 200; ++k) {
    const Vector tau = torques.next();
    arm.advance(tau, (k + 1) * 1e-3);
    // Paper, eq. 1, with friction and dampers.
    y = testing::runge_kutta_4(
        [&](const Eigen::VectorXd& state) {
          const Vector q = state.segment(0, 2), theta = state.segment(2, 2);
          const Vector v = state.segment(4, 2), thetadot = state.segment(6, 2);
          const Vector spring = drive.stiffness.cwiseProduct(theta - q) +
                                drive.spring_damping.cwiseProduct(thetadot - v);
          const Vector vdot = closed.M<double>(q).inverse() *
                              (spring - closed.C<double>(q, v) * v - closed.g<double>(q) -
                               with.drive.viscous_friction_Nms_per_rad.cwiseProduct(v));
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

TEST_P(EveryArm, ConservesEnergy) {
  const robot::Model model = testing::random_tree();
  Random random(8);
  const auto energy = [&](const ArmState& state) {
    return robot::testing::kinetic_energy<double>(model, state.q, state.v) +
           robot::potential_energy<double>(model, state.q);
  };
  Arm arm(model, options(1e-11), rigid_state(random.vector(5, 1), random.vector(5, 2)));
  const double before = energy(arm.state());
  const Vector q = arm.state().q;
  arm.advance(Vector::Zero(5), 2);
  ASSERT_GT((arm.state().q - q).norm(), 0.5);  // it moved
  // Some thousand steps of accuracy 1e-11 on energies of about 100 J.
  EXPECT_NEAR(energy(arm.state()), before, 1e-6);
}

double distance(const ArmState& a, const ArmState& b) {
  double largest = 0;
  for (const auto member : {&ArmState::q, &ArmState::v, &ArmState::theta, &ArmState::thetadot}) {
    const Vector& x = a.*member;
    const Vector& y = b.*member;
    if (x.size() == 0) continue;
    const Vector scale = y.cwiseAbs().cwiseMax(1.0);
    largest = std::max(largest, (x - y).cwiseQuotient(scale).cwiseAbs().maxCoeff());
  }
  return largest;
}

// The error of a second follows the accuracy asked of each step: some hundred steps of it at most.
TEST_P(EveryArm, KeepsTheAccuracyAskedFor) {
  const robot::Model model = robot::testing::two_link();
  const auto swing = [&](double accuracy) {
    Arm arm(model, options(accuracy), rigid_state(Eigen::Vector2d(1, -1), Vector::Zero(2)));
    arm.advance(Vector::Zero(2), 1);
    return arm.state();
  };
  const ArmState exact = swing(1e-14);
  for (const double accuracy : {1e-3, 1e-6, 1e-9}) {
    const double error = distance(swing(accuracy), exact);
    EXPECT_LT(error, 200 * accuracy);
    EXPECT_GT(error, 0);
  }
}

TEST_P(EveryArm, GivesTheSameBitsForTheSameCallsWhateverOtherArmsDo) {
  const robot::Model model = robot::testing::two_link();
  const FlexibleDrive drive = two_link_drive();
  ArmState initial;
  initial.q = initial.theta = Eigen::Vector2d(0.3, -0.2);
  initial.v = initial.thetadot = Eigen::Vector2d(1, -1);
  const ArmOptions with = options(1e-5, &drive);
  const auto run = [&](bool disturbed) {
    Arm arm(model, with, initial);
    Torques torques(2, 30);
    for (int k = 0; k < 50; ++k) {
      if (disturbed) {  // another arm lives, moves and dies
        Arm other(model, with, initial);
        other.advance(Vector::Constant(2, k), 1e-4);
      }
      arm.advance(torques.next(), (k + 1) * 1e-3);
    }
    return arm.state();
  };
  const ArmState once = run(false);
  ArmState others[4];
  std::vector<std::thread> threads;
  for (ArmState& state : others) threads.emplace_back([&] { state = run(true); });
  for (std::thread& thread : threads) thread.join();
  for (const ArmState& state : others) {
    EXPECT_TRUE(same_bits(once.q, state.q) && same_bits(once.v, state.v) &&
                same_bits(once.theta, state.theta) && same_bits(once.thetadot, state.thetadot));
  }
}

/// v' I = s i + o with i' = (tau - i) / T, from tick to tick; and no torque once it is stopped.
TEST_P(EveryArm, IsDrivenThroughCurrentLoopsWithTheirScaleAndOffset) {
  const double I = 2, hz = 40, s = 1.1, o = -0.3, h = 1e-3;
  const double T = 1 / (2 * std::numbers::pi * hz), left = std::exp(-h / T);
  ArmOptions with = options(1e-12);
  with.drive.current_loop_hz = Vector::Constant(1, hz);
  with.drive.torque_scale = Vector::Constant(1, s);
  with.drive.torque_offset_Nm = Vector::Constant(1, o);
  ArmState start = rigid_state(Vector::Zero(1), Vector::Zero(1));
  start.torque = Vector::Constant(1, 4);
  Arm arm(testing::turntable(I), with, start);
  Torques torques(1, 20);
  double v = 0, i = 4;
  for (int k = 0; k < 100; ++k) {
    const Vector tau = torques.next();
    if (k == 50) {  // the state is all that it knows
      const ArmState now = arm.state();
      arm.set_state(now, 0.05);
    }
    arm.advance(tau, (k + 1) * h);
    v += (s * (tau[0] * h + (i - tau[0]) * T * (1 - left)) + o * h) / I;
    i = tau[0] + (i - tau[0]) * left;
    ASSERT_NEAR(arm.state().torque[0], i, 1e-12);
    ASSERT_NEAR(arm.state().v[0], v, 1e-11);  // 100 steps of accuracy 1e-12
  }
  arm.brake(Vector::Constant(1, 5));
  arm.advance(Vector::Zero(1), 0.2);
  EXPECT_EQ(arm.state().torque[0], 0);
  EXPECT_NEAR(arm.state().v[0], v * std::exp(-5 * 0.1 / I), 1e-9);
}

/// A motor whose spring pulls nothing slides by (tau - Fc) / J, comes to rest, and stays there.
TEST_P(EveryArm, HasMotorsWithDryFriction) {
  FlexibleDrive drive;
  drive.stiffness = Vector::Constant(1, 1e-9);
  drive.rotor_inertia = Vector::Constant(1, 0.1);
  drive.motor_coulomb_friction_Nm = Vector::Constant(1, 0.5);
  ArmState start = rigid_state(Vector::Zero(1), Vector::Zero(1));
  start.theta = start.thetadot = Vector::Zero(1);
  Arm arm(testing::turntable(2), options(1e-12, &drive), start);
  const auto advance = [&](double tau, double until_s) {
    arm.advance(Vector::Constant(1, tau), until_s);
    return arm.state();
  };
  EXPECT_EQ(advance(0.4999, 0.1).theta[0], 0) << "held to the last bit";
  EXPECT_NEAR(advance(0.8, 0.2).thetadot[0], 3 * 0.1, 1e-9);
  const double there = 0.5 * 3 * 0.01 + 0.3 * 0.3 / (2 * 5);  // to rest within 0.06 s
  const ArmState rest = advance(0, 0.3);
  EXPECT_NEAR(rest.theta[0], there, 1e-9);
  EXPECT_EQ(rest.thetadot[0], 0);
  EXPECT_EQ(advance(-0.4999, 0.5).theta[0], rest.theta[0]);
}

/// A free spring between two inertias: phi = theta - q decays as exp(-zeta w t) cos(w' t), and
/// their momentum stays.
TEST_P(EveryArm, HasSpringsWithDampers) {
  const double I = 2, J = 0.1, K = 1e3, D = 1.5, by_inertia = 1 / I + 1 / J;
  FlexibleDrive drive;
  drive.stiffness = Vector::Constant(1, K);
  drive.rotor_inertia = Vector::Constant(1, J);
  drive.spring_damping = Vector::Constant(1, D);
  ArmState start = rigid_state(Vector::Zero(1), Vector::Zero(1));
  start.theta = Vector::Constant(1, 0.01);
  start.thetadot = Vector::Zero(1);
  Arm arm(testing::turntable(I), options(1e-12, &drive), start);
  const double w = std::sqrt(K * by_inertia), decay = D * by_inertia / 2;
  const double turns = std::sqrt(w * w - decay * decay);
  for (int k = 1; k <= 100; ++k) {
    const double t = k * 1e-3;
    arm.advance(Vector::Zero(1), t);
    const ArmState now = arm.state();
    const double phi =
        0.01 * std::exp(-decay * t) * (std::cos(turns * t) + decay / turns * std::sin(turns * t));
    ASSERT_NEAR(now.theta[0] - now.q[0], phi, 1e-11);  // 100 steps of accuracy 1e-12
    ASSERT_NEAR(I * now.v[0] + J * now.thetadot[0], 0, 1e-10);
  }
}

/// Without a torque the energy falls by the power of the dampers, D_s (thetadot - v)^2.
TEST_P(EveryArm, LosesEnergyInTheDampersOfItsSpringsAlone) {
  const robot::Model model = robot::testing::two_link();
  FlexibleDrive drive = two_link_drive();
  drive.motor_damping = {};
  ArmState start = rigid_state(Eigen::Vector2d(0.5, -0.3), Eigen::Vector2d(1, 2));
  start.theta = Eigen::Vector2d(0.51, -0.31);
  start.thetadot = Eigen::Vector2d(-1, 3);
  Arm arm(model, options(1e-12, &drive), start);
  const auto energy = [&](const ArmState& x) {
    const Vector spring = x.theta - x.q;
    return robot::testing::kinetic_energy<double>(model, x.q, x.v) +
           robot::potential_energy<double>(model, x.q) +
           0.5 * x.thetadot.dot(drive.rotor_inertia.cwiseProduct(x.thetadot)) +
           0.5 * spring.dot(drive.stiffness.cwiseProduct(spring));
  };
  const auto power = [&](const ArmState& x) {
    const Vector rate = x.thetadot - x.v;
    return rate.dot(drive.spring_damping.cwiseProduct(rate));
  };
  double before = energy(arm.state()), of_before = power(arm.state()), lost = 0;
  const double first = before, h = 2e-5;
  for (int k = 1; k <= 5000; ++k) {
    arm.advance(Vector::Zero(2), k * h);
    const double now = energy(arm.state()), of_now = power(arm.state());
    ASSERT_LE(now, before + 1e-9) << "5000 steps of accuracy 1e-12 on 100 J";
    lost += h / 2 * (of_before + of_now);
    before = now;
    of_before = of_now;
  }
  EXPECT_GT(lost, 1);
  // The trapezoidal rule errs by (w h)^2 / 12 on modes of w = 400 rad/s: 1e-5 of the sum.
  EXPECT_NEAR(first - before, lost, 1e-4 * lost);
}

/// Springs that pull nothing: each motor slows down by exp(-(damping + braking) t / J).
TEST_P(EveryArm, BrakesTheMotorsOfAFlexibleRobot) {
  const robot::Model model = robot::testing::two_link();
  FlexibleDrive drive = two_link_drive();
  drive.stiffness = Vector::Constant(2, 1e-9);
  drive.spring_damping = {};
  ArmState initial;
  initial.q = initial.theta = Eigen::Vector2d(0, 1);
  initial.v = initial.thetadot = Eigen::Vector2d(3, -2);
  Arm arm(model, options(1e-12, &drive), initial);
  arm.advance(Vector::Zero(2), 0.01);
  EXPECT_NEAR(arm.state().thetadot[0], 3 * std::exp(-0.3 * 0.01 / 0.1), 1e-9);
  EXPECT_NEAR(arm.state().thetadot[1], -2 * std::exp(-0.2 * 0.01 / 0.12), 1e-9);
  arm.set_state(initial, 0);
  arm.brake(Eigen::Vector2d(5, 6));
  arm.advance(Vector::Zero(2), 0.01);
  // The integrator's accuracy is 1e-12 a step, and the springs' torques are below 1e-10.
  EXPECT_NEAR(arm.state().thetadot[0], 3 * std::exp(-5.3 * 0.01 / 0.1), 1e-9);
  EXPECT_NEAR(arm.state().thetadot[1], -2 * std::exp(-6.2 * 0.01 / 0.12), 1e-9);
}

TEST_P(EveryArm, EndsExactlyAtTheTimeAskedFor) {
  Arm resting = arm(robot::testing::two_link(), Vector::Zero(2), Vector::Zero(2));
  resting.advance(Vector::Zero(2), 0.1);
  EXPECT_THROW(resting.advance(Vector::Zero(2), 0.1), std::logic_error);
  EXPECT_NO_THROW(resting.advance(Vector::Zero(2), std::nextafter(0.1, 1.0) + 1e-9));
}

TEST_P(EveryArm, NamesTimeCauseAndRemedyWhenItCannotGoOn) {
  Arm resting = arm(robot::testing::two_link(), Vector::Zero(2), Vector::Zero(2));
  resting.advance(Vector::Zero(2), 0.25);
  try {
    resting.advance(Vector::Constant(2, 1e200), 0.5);
    FAIL() << "integrated a torque of 1e200 N m";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr("t = 0.25 s"));
    EXPECT_THAT(error.what(), HasSubstr("shorten loop.period_s"));
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
  }
}

TEST_P(EveryArm, RefusesAWrongNumberOfJoints) {
  const robot::Model model = robot::testing::two_link();
  EXPECT_THROW(arm(model, Vector::Zero(3), Vector::Zero(3)), std::logic_error);
  Arm right = arm(model, Vector::Zero(2), Vector::Zero(2));
  EXPECT_THROW(right.advance(Vector::Zero(3), 1), std::logic_error);
  EXPECT_THROW(right.brake(Vector::Zero(1)), std::logic_error);
}

TEST_P(EveryArm, AllocatesNothingWhileItMoves) {
  const Vector zero = Vector::Zero(7);
  Arm moving = arm(robot::testing::iiwa7(), Vector::Constant(7, 0.3), zero);
  moving.advance(zero, 1e-3);
  const auto before = allocations;
  for (int k = 2; k <= 50; ++k) moving.advance(zero, k * 1e-3);
  EXPECT_EQ(allocations, before);
}

/// A chain of revolute and prismatic joints about random axes.
robot::Model chain(unsigned seed) {
  Random random(seed);
  robot::Model model;
  const int num_joints = 1 + static_cast<int>(seed % 8);
  for (int i = 0; i < num_joints; ++i) {
    model.bodies.push_back(testing::random_body(random, i - 1, i));
    if (random(0, 1) < 0.2) model.bodies.back().type = robot::JointType::prismatic;
  }
  testing::finish(model, num_joints);
  return model;
}

/// Both arms under the same torques, which jump each millisecond; friction, dry or not, and braking
/// in the last fifth.
/// @return their largest distance, each value relative to the larger of it and 1.
double largest_distance(const robot::Model& model, const FlexibleDrive* flexible, unsigned seed,
                        double coulomb = 0) {
  constexpr int ticks = 100;
  const Vector zero = Vector::Zero(model.num_joints);
  Random random(seed);
  ArmState start = rigid_state(random.vector(model.num_joints, 1), zero);
  if (flexible != nullptr) {
    start.theta = start.q;
    start.thetadot = zero;
  }
  ArmOptions options;
  options.accuracy = 1e-13;
  options.flexible = flexible;
  options.drive.viscous_friction_Nms_per_rad = Vector::Constant(model.num_joints, 0.3);
  options.drive.coulomb_friction_Nm = Vector::Constant(model.num_joints, coulomb);
  options.drive.stribeck_velocity_rad_per_s = Vector::Constant(model.num_joints, 0.01);
  Arm reference(model, options, start);
  options.mechanics = Mechanics::native;
  Arm arm(model, options, start);
  double largest = 0;
  for (int k = 1; k <= ticks; ++k) {
    const Vector tau = random.vector(model.num_joints, 5);
    if (k == ticks * 4 / 5) {
      reference.brake(Vector::Constant(model.num_joints, 2.0));
      arm.brake(Vector::Constant(model.num_joints, 2.0));
    }
    reference.advance(tau, k * 1e-3);
    arm.advance(tau, k * 1e-3);
    largest = std::max(largest, distance(arm.state(), reference.state()));
  }
  return largest;
}

// Two implementations of the mechanics: 100 ticks at a local error of 1e-13 each, which the motion
// (rates of at most some 10 1/s) lets grow by less than 10.
constexpr double agreement = 1e-10;

TEST(StepError, OfAnEntryThatIsNoNumberIsNoNumberWhereverItStands) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Vector x = Eigen::Vector3d(10, 0, -2), sound = Eigen::Vector3d(1e-3, 1e-5, 1e-3);
  EXPECT_EQ(step_error(sound, x, 0), 5e-4);
  EXPECT_EQ(step_error(sound, x, 1), 1);
  EXPECT_TRUE(std::isnan(step_error(sound, x, nan)));
  for (int i = 0; i < 3; ++i) {
    Vector error = sound;
    error[i] = nan;
    EXPECT_TRUE(std::isnan(step_error(error, x, 0))) << i;
  }
}

TEST(BothMechanics, MoveRandomRobotsAlike) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    EXPECT_LT(largest_distance(chain(seed), nullptr, seed), agreement) << "seed " << seed;
  }
  EXPECT_LT(largest_distance(testing::random_tree(), nullptr, 3), agreement);
}

TEST(BothMechanics, MoveFlexibleJointsAlike) {
  for (unsigned seed = 2; seed <= 6; ++seed) {
    const robot::Model model = chain(seed);
    const FlexibleDrive flexible{
        Vector::Constant(model.num_joints, 2000.0), Vector::Constant(model.num_joints, 0.2),
        Vector::Constant(model.num_joints, 0.1), Vector::Constant(model.num_joints, 0.3),
        Vector::Constant(model.num_joints, 2.0)};
    EXPECT_LT(largest_distance(model, &flexible, seed), agreement) << "seed " << seed;
  }
}

TEST(BothMechanics, StickAndSlideAlike) {
  for (unsigned seed = 2; seed <= 6; ++seed) {
    EXPECT_LT(largest_distance(chain(seed), nullptr, seed, 1.5), 1e-8) << "seed " << seed;
  }
}

}  // namespace
}  // namespace tachless::plant

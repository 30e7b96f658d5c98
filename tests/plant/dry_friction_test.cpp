#include "plant/dry_friction.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "robot/dynamics.h"
#include "tests/core/robot/energy.h"
#include "tests/plant/arms.h"

namespace tachless::plant {
namespace {

using testing::Random;
using testing::rigid_state;
using testing::turntable;

struct Friction {
  double coulomb, held, stribeck = 0.01, viscous = 0, rise = 0, load = 0;
};

class DryFriction : public ::testing::TestWithParam<Mechanics> {};
INSTANTIATE_TEST_SUITE_P(, DryFriction, ::testing::Values(Mechanics::simbody, Mechanics::native),
                         testing::name_of_mechanics);

ArmOptions options(const Friction& friction, int num_joints = 1) {
  ArmOptions result;
  result.mechanics = DryFriction::GetParam();
  result.accuracy = 1e-10;
  result.drive.coulomb_friction_Nm = Vector::Constant(num_joints, friction.coulomb);
  result.drive.static_friction_Nm = Vector::Constant(num_joints, friction.held);
  result.drive.stribeck_velocity_rad_per_s = Vector::Constant(num_joints, friction.stribeck);
  result.drive.viscous_friction_Nms_per_rad = Vector::Constant(num_joints, friction.viscous);
  result.drive.friction_rise_Nm = Vector::Constant(num_joints, friction.rise);
  result.drive.friction_rise_velocity_rad_per_s = Vector::Constant(num_joints, 0.3);
  result.drive.load_friction = Vector::Constant(num_joints, friction.load);
  return result;
}

ArmState at(double q, double v) {
  return rigid_state(Vector::Constant(1, q), Vector::Constant(1, v));
}
Vector torque(double tau) { return Vector::Constant(1, tau); }

TEST_P(DryFriction, StopsAJointWhereCoulombAndViscousFrictionDoAndItStaysThere) {
  constexpr double I = 0.5, Fc = 1.5, b = 0.2, v0 = -2;
  Arm arm(turntable(I), options({Fc, Fc, 0.01, b}), at(0.3, v0));
  // I vdot = -b v + Fc: at rest after stop_s, having gone (I v0 + Fc stop_s)/b.
  const double stop_s = I / b * std::log(1 - b * v0 / Fc);
  const double end = 0.3 + (I * v0 + Fc * stop_s) / b;
  ASSERT_GT(stop_s, 0.5);
  for (int k = 1; k * 1e-3 < stop_s; ++k) arm.advance(torque(0), k * 1e-3);
  EXPECT_LT(arm.state().v[0], 0);
  arm.advance(torque(0), stop_s + 1e-3);
  EXPECT_EQ(arm.state().v[0], 0);
  EXPECT_NEAR(arm.state().q[0], end, 1e-8);  // 600 steps of accuracy 1e-10
  const double there = arm.state().q[0];
  for (int k = 1; k < 100; ++k) arm.advance(torque(0), stop_s + 1e-3 + k);
  EXPECT_EQ(arm.state().q[0], there);
}

/// A block on a horizontal rail.
robot::Model block(double mass) {
  robot::Model model = turntable(1);
  model.bodies[0].type = model.joint_types[0] = robot::JointType::prismatic;
  model.bodies[0].mass = mass;
  model.gravity.setZero();
  return model;
}

TEST_P(DryFriction, StopsABlockWhereTheClosedFormDoesFromTwoThousandStarts) {
  constexpr double m = 2;
  const robot::Model model = block(m);
  Random random(9);
  const int starts = GetParam() == Mechanics::native ? 2000 : 200;
  for (int k = 0; k < starts; ++k) {
    const double v0 = random(0.01, 3), Fc = random(0.5, 20), h = random(1e-4, 5e-3);
    const double end = m * v0 * v0 / (2 * Fc), stop_s = m * v0 / Fc;
    Arm arm(model, options({Fc, Fc}), at(0, v0));
    double speed = v0;
    for (int tick = 1; (tick - 2) * h < stop_s; ++tick) {
      arm.advance(torque(0), tick * h);
      const double v = arm.state().v[0];
      ASSERT_GE(v, 0) << "start " << k << ", tick " << tick;
      ASSERT_LE(v, speed) << "friction gives energy";
      speed = v;
    }
    ASSERT_EQ(speed, 0) << "start " << k;
    ASSERT_NEAR(arm.state().q[0], end, 1e-9) << "start " << k;
  }
}

TEST_P(DryFriction, StopsAnArmAlikeWhateverTheTick) {
  robot::Model model = robot::testing::load("scenarios/robots/ur5e.urdf");
  model.gravity.setZero();
  Random random(10);
  const int starts = GetParam() == Mechanics::native ? 40 : 2;
  for (int k = 0; k < starts; ++k) {
    const ArmState start = rigid_state(random.vector(6, 1), random.vector(6, 1));
    const auto after = [&](int ticks) {
      Arm arm(model, options({2, 3, 0.05}, 6), start);
      double energy = robot::testing::kinetic_energy<double>(model, start.q, start.v);
      for (int i = 1; i <= ticks; ++i) {
        arm.advance(Vector::Zero(6), i * 0.3 / ticks);
        const ArmState now = arm.state();
        const double left = robot::testing::kinetic_energy<double>(model, now.q, now.v);
        EXPECT_LE(left, energy + 1e-9);  // steps of accuracy 1e-10
        energy = left;
      }
      return arm.state();
    };
    const ArmState coarse = after(300), fine = after(6000);
    EXPECT_LT((coarse.q - fine.q).norm(), 1e-7) << k;
    EXPECT_LT((coarse.v - fine.v).norm(), 1e-6) << k;
  }
}

TEST_P(DryFriction, HoldsAJointAtRestUpToStaticFrictionToTheLastBit) {
  Arm arm(turntable(0.5), options({1, 2}), at(0.3, 0));
  for (int k = 1; k <= 2000; ++k) arm.advance(torque(k % 2 == 0 ? 1.999999 : -2), k * 1e-3);
  EXPECT_EQ(arm.state().q[0], 0.3);
  EXPECT_EQ(arm.state().v[0], 0);
  arm.advance(torque(2.0001), 3);
  EXPECT_GT(arm.state().v[0], 0);
}

TEST_P(DryFriction, LetsAJointThatMovesGoOnUnderATorqueThatWouldNotStartIt) {
  constexpr double I = 0.5;
  Arm resting(turntable(I), options({1, 2}), at(0, 0)),
      moving(turntable(I), options({1, 2}), at(0, 1));
  resting.advance(torque(1.5), 2);
  EXPECT_EQ(resting.state().q[0], 0);
  moving.advance(torque(1.5), 2);
  // Far above the Stribeck velocity, exp(-10^4) = 0: I vdot = 1.5 - 1.
  EXPECT_NEAR(moving.state().v[0], 2 * 0.5 / I + 1, 1e-8);
}

TEST_P(DryFriction, FallsFromStaticToCoulombsAsStribecksCurve) {
  constexpr double I = 0.5, Fc = 1, Fs = 2, vs = 0.5, tau = 2.1;
  Arm arm(turntable(I), options({Fc, Fs, vs}), at(0, 0));
  arm.advance(torque(tau), 1);
  const Eigen::VectorXd y = testing::runge_kutta_4(
      [&](const Eigen::VectorXd& state) {
        const double v = state[1], F = Fc + (Fs - Fc) * std::exp(-v * v / (vs * vs));
        return Eigen::VectorXd(Eigen::Vector2d(v, (tau - F) / I));
      },
      Eigen::Vector2d(0, 0), 1, 20000);
  ASSERT_GT(y[1], 0.3);
  EXPECT_NEAR(arm.state().q[0], y[0], 1e-8);  // tens of steps of accuracy 1e-10
  EXPECT_NEAR(arm.state().v[0], y[1], 1e-8);
}

/// A joint about a horizontal axis, whose mass gravity pulls down at q = 0.
robot::Model pendulum(double mass, double length) {
  robot::Model model = turntable(0.1);
  model.bodies[0].mass = mass;
  model.bodies[0].p_Bcm = {length, 0, 0};
  model.gravity = {0, -9.81, 0};
  return model;
}

TEST_P(DryFriction, RisesOrFallsWithSpeedAndGrowsWithGravitysTorque) {
  constexpr double m = 2, r = 0.3, Fc = 1.5, load = 0.2, viscous = 0.3;
  const robot::Model model = pendulum(m, r);
  const double I = robot::mass_matrix(model, Vector(Vector::Zero(1)))(0, 0);
  for (const double rise : {0.8, -0.9}) {
    Arm arm(model, options({Fc, Fc, 0.01, viscous, rise, load}), at(-2, 3));
    const Eigen::VectorXd y = testing::runge_kutta_4(
        [&](const Eigen::VectorXd& state) {
          const double v = state[1], g = 9.81 * m * r * std::cos(state[0]);
          const double F = Fc + load * std::abs(g) + rise * std::tanh(v / 0.3) + viscous * v;
          return Eigen::VectorXd(Eigen::Vector2d(v, (-g - F) / I));
        },
        Eigen::Vector2d(-2, 3), 0.25, 20000);
    ASSERT_GT(y[1], 0.5);  // it moves one way, and gravity's torque changes its sign
    ASSERT_GT(y[0], -1.5);
    arm.advance(torque(0), 0.25);
    // Steps of accuracy 1e-10; |g| has a kink, at which the steps are shorter.
    EXPECT_NEAR(arm.state().q[0], y[0], 1e-7) << rise;
    EXPECT_NEAR(arm.state().v[0], y[1], 1e-7) << rise;
  }
}

TEST_P(DryFriction, HoldsMoreWhereGravityPullsMore) {
  constexpr double m = 2, r = 0.3, Fs = 1, load = 0.2;
  const robot::Model model = pendulum(m, r);
  for (const double q : {0.0, 1.2, 2.5}) {
    const double g = 9.81 * m * r * std::cos(q), held = Fs + load * std::abs(g);
    Arm arm(model, options({Fs, Fs, 0.01, 0, 0, load}), at(q, 0));
    arm.advance(torque(g + held * (1 - 1e-6)), 0.5);
    EXPECT_EQ(arm.state().q[0], q);
    arm.advance(torque(g + held * (1 + 1e-6)), 0.6);
    EXPECT_GT(arm.state().v[0], 0);
  }
}

TEST_P(DryFriction, LetsALinkGoInTheMiddleOfATickWhenItsSpringPullsHardEnough) {
  constexpr double K = 100, J = 0.2, tau = 3, Fs = 4;
  const FlexibleDrive drive{
      Vector::Constant(1, K), Vector::Constant(1, J), Vector::Constant(1, 0.0), {}};
  ArmOptions with = options({Fs, Fs});
  with.flexible = &drive;
  ArmState start = at(0, 0);
  start.theta = start.thetadot = Vector::Zero(1);
  // The held link gives theta = tau/K (1 - cos w t).
  const double w = std::sqrt(K / J), lets_go_s = std::acos(1 - Fs / tau) / w;
  Arm held(turntable(0.5), with, start), gone(turntable(0.5), with, start);
  held.advance(torque(tau), lets_go_s - 1e-7);
  EXPECT_EQ(held.state().q[0], 0);
  gone.advance(torque(tau), lets_go_s + 1e-2);
  // The released link has I vdot = K thetadot t, to leading order.
  const double rate = tau * w * std::sin(w * lets_go_s) / 0.5;
  EXPECT_NEAR(gone.state().v[0], rate * 1e-4 / 2, 0.1 * rate * 1e-4 / 2);  // higher orders: w t/3
}

/// Returns the accelerations. Tries all 3^n choices of joints that stick or slide either way.
Vector by_trial(const Matrix& M, const Vector& r, double held) {
  const auto n = static_cast<int>(r.size());
  int choices = 1;
  for (int i = 0; i < n; ++i) choices *= 3;
  for (int c = 0; c < choices; ++c) {
    Matrix A = M;
    Vector F = Vector::Zero(n), b = r;
    std::vector<int> direction;
    for (int i = 0, rest = c; i < n; ++i, rest /= 3) {
      direction.push_back(rest % 3 - 1);
      F[i] = direction.back() * held;
    }
    b -= F;
    for (int i = 0; i < n; ++i) {
      if (direction[static_cast<std::size_t>(i)] != 0) continue;
      A.row(i) = Eigen::RowVectorXd::Unit(n, i);
      b[i] = 0;
    }
    Vector a = Eigen::MatrixXd(A).fullPivLu().solve(Eigen::VectorXd(b));
    const Vector needed = r - M * a;
    bool fits = true;
    for (int i = 0; i < n; ++i) {
      const int d = direction[static_cast<std::size_t>(i)];
      fits = fits && (d == 0 ? std::abs(needed[i]) <= held : a[i] * d > 0);
    }
    if (fits) return a;
  }
  ADD_FAILURE() << "no choice fits";
  return {};
}

TEST_P(DryFriction, StartsThoseJointsOfAnArmAtRestThatTryingEveryChoiceStarts) {
  Random random(3);
  robot::Model model;
  for (int i = 0; i < 5; ++i) model.bodies.push_back(testing::random_body(random, i - 1, i));
  testing::finish(model, 5);
  const ArmOptions with = options({3, 3}, 5);
  const Vector zero = Vector::Zero(5);
  int some = 0;
  for (int k = 0; k < 200; ++k) {
    const Vector q = random.vector(5, 3),
                 tau = random.vector(5, 5) + robot::gravity_torque(model, q);
    // In this short step from rest, the acceleration changes by at most a part in 1e10.
    constexpr double h = 1e-7;
    Arm arm(model, with, rigid_state(q, zero));
    arm.advance(tau, h);
    const Vector a = arm.state().v / h;
    const Vector expected =
        by_trial(robot::mass_matrix(model, q), tau - robot::gravity_torque(model, q), 3);
    // The two results solve one system with a condition number of some hundreds.
    EXPECT_LT((a - expected).norm(), 1e-9 * (1 + expected.norm())) << k;
    // A held joint has exactly 0; the other solution rounds.
    EXPECT_TRUE(((a.array() == 0) == (expected.array().abs() < 1e-12)).all()) << k;
    const auto at_rest = (expected.array() == 0).count();
    some += at_rest > 0 && at_rest < 5 ? 1 : 0;
  }
  EXPECT_GT(some, 100);  // some joints stick and some slide
}

TEST_P(DryFriction, TakesEnergyAndGivesNoneUntilTheArmHangsStill) {
  const robot::Model model = testing::random_chain();
  Random random(5);
  Arm arm(model, options({2, 3, 0.05}, 7), rigid_state(random.vector(7, 1), random.vector(7, 3)));
  const auto energy = [&] {
    return robot::testing::kinetic_energy<double>(model, arm.state().q, arm.state().v) +
           robot::potential_energy<double>(model, arm.state().q);
  };
  double before = energy();
  const double begin = before;
  int k = 0;
  for (; k < 40000 && !arm.state().v.isZero(0); ++k) {
    arm.advance(Vector::Zero(7), (k + 1) * 1e-3);
    EXPECT_LT(energy(), before + 1e-8);  // a tick's steps of accuracy 1e-10 on 100 J
    before = energy();
  }
  EXPECT_LT(k, 40000);
  EXPECT_LT(before, begin - 5);
  // Friction holds the arm away from its equilibrium.
  const Vector q = arm.state().q;
  EXPECT_GT(robot::gravity_torque(model, q).norm(), 0.1);
  arm.advance(Vector::Zero(7), k * 1e-3 + 10);
  EXPECT_EQ(arm.state().q, q);
}

TEST_P(DryFriction, IsRefusedWhereItMakesNoSense) {
  EXPECT_THROW(Arm(turntable(1), options({2, 1}), at(0, 0)), std::logic_error);
  EXPECT_THROW(Arm(turntable(1), options({2, 2, 0}), at(0, 0)), std::logic_error);
  EXPECT_THROW(Arm(turntable(1), options({2, 2, 1, 0, -2.1}), at(0, 0)), std::logic_error);
  EXPECT_THROW(Arm(turntable(1), options({0, 0, 1, 0, 0, 0.1}), at(0, 0)), std::logic_error);
}

}  // namespace
}  // namespace tachless::plant

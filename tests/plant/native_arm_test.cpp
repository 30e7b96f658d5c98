#include <gtest/gtest.h>

#include <stdexcept>

#include "plant/arm.h"
#include "tests/plant/arms.h"
#include "tests/support/counting_new.h"

namespace tachless::plant {
namespace {

using robot::Vector;
using testing::Random;
using testing::rigid_state;

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

ArmOptions options(Mechanics mechanics, double accuracy, const FlexibleDrive* flexible = nullptr) {
  ArmOptions result;
  result.mechanics = mechanics;
  result.integrator.accuracy = accuracy;
  result.flexible = flexible;
  return result;
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

/// Both arms under the same torques, which jump each millisecond; friction, and braking in the
/// last fifth.
/// @return their largest distance, each value relative to the larger of it and 1.
double largest_distance(const robot::Model& model, const FlexibleDrive* flexible, unsigned seed) {
  constexpr double accuracy = 1e-13;
  constexpr int ticks = 100;
  const Vector zero = Vector::Zero(model.num_joints);
  Random random(seed);
  ArmState start = rigid_state(random.vector(model.num_joints, 1), zero);
  if (flexible != nullptr) {
    start.theta = start.q;
    start.thetadot = zero;
  }
  ArmOptions simbody = options(Mechanics::simbody, accuracy, flexible);
  ArmOptions native = options(Mechanics::native, accuracy, flexible);
  simbody.drive.viscous_friction_Nms_per_rad = native.drive.viscous_friction_Nms_per_rad =
      Vector::Constant(model.num_joints, 0.3);
  Arm reference(model, simbody, start);
  Arm arm(model, native, start);
  double largest = 0;
  for (int k = 1; k <= ticks; ++k) {
    const Vector tau = random.vector(model.num_joints, 5);
    if (k == ticks * 4 / 5) {
      const Vector damping = Vector::Constant(model.num_joints, 2.0);
      reference.brake(damping);
      arm.brake(damping);
    }
    reference.advance(tau, k * 1e-3);
    arm.advance(tau, k * 1e-3);
    largest = std::max(largest, distance(arm.state(), reference.state()));
  }
  return largest;
}

// Two implementations of the mechanics and of the integrator: 100 ticks at a local error of 1e-13
// each, which the motion (rates of at most some 10 1/s) lets grow by less than 10.
constexpr double agreement = 1e-10;

TEST(NativeArm, MovesTwentyRandomRobotsAsSimbodyDoes) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    EXPECT_LT(largest_distance(chain(seed), nullptr, seed), agreement) << "seed " << seed;
  }
}

TEST(NativeArm, MovesATreeWithPrismaticAndMimicJointsAsSimbodyDoes) {
  EXPECT_LT(largest_distance(testing::random_tree(), nullptr, 3), agreement);
}

TEST(NativeArm, MovesFlexibleJointsAsSimbodyDoes) {
  for (unsigned seed = 2; seed <= 6; ++seed) {
    const robot::Model model = chain(seed);
    const FlexibleDrive flexible{Vector::Constant(model.num_joints, 2000.0),
                                 Vector::Constant(model.num_joints, 0.2),
                                 Vector::Constant(model.num_joints, 0.1)};
    EXPECT_LT(largest_distance(model, &flexible, seed), agreement) << "seed " << seed;
  }
}

TEST(NativeArm, AcceleratesWithRotorInertiaAsSimbodyDoes) {
  robot::Model model = robot::testing::two_link();
  model.rotor_inertia = Eigen::Vector2d(0.1, 0.2);
  const ArmState state = rigid_state(Eigen::Vector2d(0.2, 0.9), Eigen::Vector2d(-1, 0.5));
  const Vector tau = Eigen::Vector2d(3, -4);
  const Vector expected =
      Arm(model, options(Mechanics::simbody, 1e-9), state).acceleration(tau).vdot;
  const Vector vdot = Arm(model, options(Mechanics::native, 1e-9), state).acceleration(tau).vdot;
  EXPECT_LT((vdot - expected).norm(), 1e-12 * expected.norm());  // rounding, cond(M) = 20
}

/// A second of the paper's arm, swinging freely from rest at (1, -1): its distance from the same
/// motion at an accuracy that leaves rounding alone.
double error_of(Integrator method, double accuracy) {
  const robot::Model model = robot::testing::two_link();
  const ArmState start = rigid_state(Eigen::Vector2d(1, -1), Vector::Zero(2));
  ArmOptions chosen = options(Mechanics::native, accuracy);
  chosen.integrator.method = method;
  Arm arm(model, chosen, start);
  Arm exact(model, options(Mechanics::native, 1e-14), start);
  arm.advance(Vector::Zero(2), 1);
  exact.advance(Vector::Zero(2), 1);
  return distance(arm.state(), exact.state());
}

// The error of a second follows the accuracy asked of each step: some hundred steps of it at most.
TEST(NativeArm, KeepsTheAccuracyAskedForWithEachMethod) {
  for (const Integrator method : {Integrator::runge_kutta_merson, Integrator::runge_kutta_3,
                                  Integrator::runge_kutta_feldberg}) {
    for (const double accuracy : {1e-6, 1e-9}) {
      const double error = error_of(method, accuracy);
      EXPECT_LT(error, 200 * accuracy) << static_cast<int>(method);
      EXPECT_GT(error, 0) << static_cast<int>(method);
    }
  }
}

TEST(NativeArm, RefusesTheIntegratorsThatOnlySimbodyHas) {
  const robot::Model model = robot::testing::two_link();
  for (const Integrator method :
       {Integrator::verlet, Integrator::cpodes, Integrator::semi_explicit_euler_2}) {
    ArmOptions chosen = options(Mechanics::native, 1e-9);
    chosen.integrator.method = method;
    EXPECT_THROW(Arm(model, chosen, rigid_state(Vector::Zero(2), Vector::Zero(2))),
                 std::invalid_argument);
  }
}

TEST(NativeArm, SaysWhenItCannotBeIntegratedOn) {
  const robot::Model model = robot::testing::two_link();
  Arm arm(model, options(Mechanics::native, 1e-9), rigid_state(Vector::Zero(2), Vector::Zero(2)));
  EXPECT_THROW(arm.advance(Vector::Constant(2, 1e200), 1), std::runtime_error);
}

TEST(NativeArm, AllocatesNothingWhileItMoves) {
  const robot::Model model = robot::testing::iiwa7();
  const Vector zero = Vector::Zero(7);
  Arm arm(model, options(Mechanics::native, 1e-9), rigid_state(Vector::Constant(7, 0.3), zero));
  arm.advance(zero, 1e-3);
  const auto before = allocations;
  for (int k = 2; k <= 50; ++k) arm.advance(zero, k * 1e-3);
  EXPECT_EQ(allocations, before);
}

}  // namespace
}  // namespace tachless::plant

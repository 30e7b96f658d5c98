#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "robot/dynamics.h"
#include "robot/gravity_bound.h"
#include "tests/core/robot/energy.h"
#include "tests/core/robot/robots.h"
#include "tests/support/rounding.h"

namespace tachless::robot {
namespace {

using testing::Random;

class Energy : public ::testing::TestWithParam<Model (*)()> {
 protected:
  const Model model = GetParam()();
  const Eigen::Index n = model.num_joints;
  Random random{9};
};
INSTANTIATE_TEST_SUITE_P(Robots, Energy,
                         ::testing::Values([] { return testing::two_link(); }, &testing::iiwa7,
                                           &testing::branching));

TEST_P(Energy, IsHalfOfVMVAndItsGradientIsGravity) {
  for (int k = 0; k < 100; ++k) {
    const Vector q = random.vector(n, 3), v = random.vector(n, 3), zero = Vector::Zero(n);
    const double T = testing::kinetic_energy(model, q, v);
    EXPECT_NEAR(T, 0.5 * v.dot(mass_matrix(model, q) * v), 100 * eps * (1 + T));
    const Vector g = gravity_torque(model, q);
    for (Eigen::Index j = 0; j < n; ++j) {
      const JetVector along = jet(q, Vector::Unit(n, j), zero);
      // Weights of up to 250 N on arms of up to 2 m.
      EXPECT_NEAR(potential_energy(model, along).first, g[j], 64 * eps * 500);
    }
  }
}

TEST_P(Energy, NoPostureHasMoreGravityThanItsBound) {
  const Vector bound = gravity_bound(model);
  for (int k = 0; k < 2000; ++k) {
    // Prismatic joints stay within their ranges.
    Vector q = random.vector(n, 3);
    for (const Body& body : model.bodies) {
      const Eigen::Index j = body.coordinate;
      if (body.type == JointType::prismatic)
        q[j] = std::clamp(q[j], model.lower[j], model.upper[j]);
    }
    const Vector g = gravity_torque(model, q);
    for (Eigen::Index j = 0; j < n; ++j) EXPECT_LE(std::abs(g[j]), bound[j] + 64 * eps * 500);
  }
}

/// A pendulum bears most where it is level: m g r. Beyond it the bound of a chain is that of the
/// straight chain.
TEST(GravityBound, OfTwoLinksIsThatOfTheStraightArm) {
  const Model arm = testing::two_link(2);
  const Vector level = gravity_torque(arm, Vector{{std::numbers::pi / 2, 0}}).cwiseAbs();
  const Vector bound = gravity_bound(arm);
  for (Eigen::Index j = 0; j < 2; ++j) EXPECT_NEAR(bound[j], level[j], 1e-9 * level[j]);
}

/// Largest departure from the initial energy over one second of free fall by classical
/// Runge-Kutta steps of `h`.
double energy_drift(const Model& model, double h) {
  const Eigen::Index n = model.num_joints;
  const Vector tau = Vector::Zero(n);
  Vector q = Vector::LinSpaced(n, 0.4, -0.3), v = Vector::LinSpaced(n, -0.5, 0.5);
  const auto energy = [&] {
    return testing::kinetic_energy(model, q, v) + potential_energy(model, q);
  };
  const auto acceleration = [&](const Vector& at, const Vector& rate) {
    return forward_dynamics(model, at, rate, tau);
  };
  const double start = energy();
  double drift = 0;
  const int steps = static_cast<int>(std::lround(1 / h));
  for (int k = 0; k < steps; ++k) {
    const Vector v1 = v, a1 = acceleration(q, v1);
    const Vector v2 = v + h / 2 * a1, a2 = acceleration(q + h / 2 * v1, v2);
    const Vector v3 = v + h / 2 * a2, a3 = acceleration(q + h / 2 * v2, v3);
    const Vector v4 = v + h * a3, a4 = acceleration(q + h * v3, v4);
    q += h / 6 * (v1 + 2 * v2 + 2 * v3 + v4);
    v += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
    drift = std::max(drift, std::abs(energy() - start));
  }
  return drift;
}

TEST_P(Energy, IsConservedToTheOrderOfTheIntegrator) {
  const double coarse = energy_drift(model, 5e-3), fine = energy_drift(model, 2.5e-3);
  // Fourth order: halving the step divides the drift by 16, or by 32 where the leading term
  // happens to conserve energy. Energies are tens of joules.
  EXPECT_GT(coarse / fine, 11);
  EXPECT_LT(coarse / fine, 40);
  EXPECT_LT(fine, 1e-3);
}

}  // namespace
}  // namespace tachless::robot

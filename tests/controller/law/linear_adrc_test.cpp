#include "controller/law/rivals/linear_adrc.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/controller/law/closed_loop.h"

namespace tachless::controller::law::linear_adrc_test {
namespace {

LinearAdrc law_at(double period_s, Vector limit = {}) {
  Settings settings{period_s};
  settings.torque_limit = std::move(limit);
  return {two_link_model(), {vector(20, 20), vector(200, 200), vector(10.3, 0.62)}, settings};
}

const Sine still{{0, 0}, 1};

/// With u = 0 the observer's error obeys z -> A z, and (A - p)^3 = 0.
TEST(LinearAdrc, PlacesTheThreePolesOfItsObserver) {
  const double h = 1e-3, pole = std::exp(-200 * h);
  const LinearAdrc law = law_at(h);
  const Vector none = vector(0, 0);
  const messages::PositionMeasurement measured{none};
  Eigen::Matrix3d A;
  for (int column = 0; column < 3; ++column) {
    LinearAdrc::Memory z{none, none, none, none};
    (column == 0 ? z.z1 : column == 1 ? z.z2 : z.z3)[0] = 1;
    const auto next = law.step(z, measured, still.at(0)).memory;
    A.col(column) << next.z1[0], next.z2[0], next.z3[0];
  }
  const Eigen::Matrix3d size = Eigen::Vector3d(1, 1 / h, 1 / (h * h)).asDiagonal();
  const Eigen::Matrix3d N = size.inverse() * A * size - pole * Eigen::Matrix3d::Identity();
  EXPECT_LT((N * N * N).norm(), 1e-13);
  EXPECT_GT((N * N).norm(), 1e-4);
}

TEST(LinearAdrc, IsItsFormula) {
  const LinearAdrc law = law_at(1e-3);
  Random random(1);
  for (int k = 0; k < 100; ++k) {
    const messages::ReferencePoint r = random.reference();
    const messages::PositionMeasurement measured{random.pair(1)};
    const LinearAdrc::Memory z{random.pair(1), random.pair(3), random.pair(30), random.pair(30)};
    const auto step = law.step(z, measured, r);
    const auto& next = step.memory;
    const Vector u = -400 * next.z1 - 40 * next.z2 - next.z3;
    const Vector tau = robot::inverse_dynamics(two_link_model(), measured.q, r.v_ref, r.a_ref) +
                       vector(10.3, 0.62).cwiseProduct(u);
    EXPECT_LT((step.command.tau - tau).norm(), 1e-9);
    EXPECT_EQ(next.u, Vector(u));
  }
}

/// Half a kilogram that the model does not know of is a disturbance: no error is left at rest.
TEST(LinearAdrc, LeavesNoErrorUnderAnUnknownLoad) {
  const auto states = sampled_loop(law_at(1e-3), rigid_state({0.05, -0.05}, {0, 0}),
                                   RigidArm{{0.5}}, RigidArm::position, still, 1e-3, 4000);
  EXPECT_LT(final_error(states, still, 1e-3, 100), 1e-7);
}

TEST(LinearAdrc, TellsItsObserverWhatASaturatedDriveGives) {
  const Vector limit = vector(120, 20);
  const LinearAdrc law = law_at(1e-3, limit);
  const LinearAdrc::Memory z = law.start({vector(3, 3)}, still.at(0));
  const auto step = law.step(z, {vector(3, 3)}, still.at(0));
  ASSERT_LT(step.command.tau[0], -120);
  const Vector g = robot::gravity_torque(two_link_model(), vector(3, 3));
  EXPECT_NEAR(step.memory.u[0], (-120 - g[0]) / 10.3, 1e-12);
}

}  // namespace
}  // namespace tachless::controller::law::linear_adrc_test

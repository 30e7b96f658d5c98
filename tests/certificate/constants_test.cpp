#include "certificate/constants.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "robot/inverse_dynamics.h"
#include "tests/certificate/loops.h"

namespace tachless::certificate {
namespace {

using robot::Vector;

/// Closed forms at mp = 0; the table of the robot's data sheet (six digits) at both payloads.
TEST(Constants, AreThoseOfTheTwoLinkArm) {
  const struct {
    double payload, lambda_min, lambda_max, k_c;
  } rows[] = {{0, 0.447361, 9.962639, 0.838690}, {0.5, 0.657145, 12.252855, 1.660935}};
  for (const auto& row : rows) {
    const robot::Model model = robot::testing::two_link(row.payload);
    const RobotConstants c = robot_constants(model, Postures(model));
    EXPECT_NEAR(c.lambda_min_M.value, row.lambda_min, 1e-6);
    EXPECT_NEAR(c.lambda_max_M.value, row.lambda_max, 1e-6);
    EXPECT_NEAR(c.k_c.value, row.k_c, 1e-6);
    // C' - C = h sin q2 [0, 2 x1 + x2; -(2 x1 + x2), 0], whose norm is at most sqrt(5) h.
    const double h = 0.51 + row.payload;
    EXPECT_NEAR(c.k_s.value, std::sqrt(5.0) * h, 1e-8);
    EXPECT_NEAR(c.k_y.value, 0.6156 * h / 0.51, 1e-4);
    EXPECT_NEAR(std::abs(c.k_c.q[1]), std::numbers::pi / 2, 1e-3);
    EXPECT_NEAR(c.lambda_max_M.q[1], 0, 1e-3);
    // Both links along the horizontal.
    const double g1 = 7.6 + row.payload, g2 = 0.63 + row.payload;
    EXPECT_NEAR(c.sup_g.value, 9.81 * std::hypot(g1 + g2, g2), 1e-6);
  }
}

TEST(Constants, GradientOfGravityIsThatOfTheLiterature) {
  const robot::Model model = robot::testing::two_link();
  EXPECT_NEAR(robot_constants(model, Postures(model)).k_g.value, 81.2, 0.05);
}

TEST(Constants, OfTwoJointsAreBoundedBetweenThePostures) {
  const robot::Model model = robot::testing::two_link();
  const RobotConstants c = robot_constants(model, Postures(model));
  for (const Extreme* up : {&c.lambda_max_M, &c.k_c, &c.k_s, &c.k_y}) {
    EXPECT_TRUE(up->proved);
    EXPECT_GE(up->bound, up->value);
    EXPECT_LT(up->bound, up->value * (1 + 2e-4));  // 360 postures, 360 directions
  }
  EXPECT_LE(c.lambda_min_M.bound, c.lambda_min_M.value);
  EXPECT_GT(c.lambda_min_M.bound, c.lambda_min_M.value * (1 - 2e-4));
  EXPECT_FALSE(c.k_g.proved);
}

TEST(Constants, OfSevenJointsAreNotExceededByRandomPostures) {
  const robot::Model model = robot::testing::iiwa7();
  PostureOptions options;
  options.samples = 256;
  const RobotConstants c = robot_constants(model, Postures(model, options));
  EXPECT_FALSE(c.k_c.proved);
  EXPECT_GT(c.lambda_max_M.value / c.lambda_min_M.value, 1000);
  robot::testing::Random random(5);
  for (int i = 0; i < 3000; ++i) {
    const Vector q = random.vector(7, std::numbers::pi), x = random.vector(7, 1);
    const Inertia at = inertia_at(model, q);
    const Eigen::MatrixXd C = at.coriolis(x.normalized());
    ASSERT_LE(largest_eigenvalue(at.M), c.lambda_max_M.value);
    ASSERT_GE(smallest_eigenvalue(at.M), c.lambda_min_M.value);
    ASSERT_LE(spectral_norm(C), c.k_c.value);
    ASSERT_LE(spectral_norm(C.transpose() - C), c.k_s.value);
    ASSERT_LE(spectral_norm((C + C.transpose()) / 2), c.k_y.value);
    ASSERT_LE(robot::gravity_torque(model, q).norm(), c.sup_g.value);
    ASSERT_LE(spectral_norm(gravity_gradient(model, q)), c.k_g.value);
  }
}

}  // namespace
}  // namespace tachless::certificate

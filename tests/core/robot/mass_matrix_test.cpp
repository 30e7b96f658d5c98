#include "robot/dynamics.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <vector>

#include "tests/core/robot/robots.h"
#include "tests/support/rounding.h"

namespace tachless::robot {
namespace {

using testing::Random;

class MassMatrix : public ::testing::TestWithParam<Model (*)()> {
 protected:
  const Model model = GetParam()();
  const Eigen::Index n = model.num_joints;
  Random random{3};
};
INSTANTIATE_TEST_SUITE_P(
    Robots, MassMatrix,
    ::testing::Values([] { return testing::two_link(); }, &testing::iiwa7, &testing::branching,
                      [] { return model_from_urdf(testing::chain_urdf(64, 64), "chain"); }));

TEST_P(MassMatrix, IsSymmetricToTheLastBitAndPositiveDefinite) {
  for (int k = 0; k < 50; ++k) {
    const Matrix M = mass_matrix(model, random.vector(n, 3));
    EXPECT_EQ(M, M.transpose());
    EXPECT_GT(Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(M).eigenvalues().minCoeff(), 0);
  }
}

TEST_P(MassMatrix, HasTheTorqueOfUnitAccelerationsAsItsColumns) {
  Model weightless = model;
  weightless.gravity.setZero();
  for (int k = 0; k < 20; ++k) {
    const Vector q = random.vector(n, 3), zero = Vector::Zero(n);
    const Matrix M = mass_matrix(model, q);
    for (Eigen::Index j = 0; j < n; ++j) {
      const Vector e = Vector::Unit(n, j);
      // Two recursions over up to 128 bodies, each rounding a few times per body.
      EXPECT_LT((M.col(j) - inverse_dynamics(weightless, q, zero, e)).cwiseAbs().maxCoeff(),
                8 * eps * static_cast<double>(model.bodies.size()) * M.cwiseAbs().maxCoeff());
    }
  }
}

TEST_P(MassMatrix, DoesNotDependOnTheOrderOfItsBodies) {
  // Level by level in place of branch by branch: a subtree's bodies are not side by side.
  std::vector<int> level(model.bodies.size(), 0), order(model.bodies.size()), at(order.size());
  for (std::size_t i = 0; i < order.size(); ++i) {
    const int parent = model.bodies[i].parent;
    if (parent >= 0) level[i] = level[static_cast<std::size_t>(parent)] + 1;
    order[i] = static_cast<int>(i);
  }
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
    return level[static_cast<std::size_t>(a)] < level[static_cast<std::size_t>(b)];
  });
  Model by_level = model;
  for (std::size_t i = 0; i < order.size(); ++i) {
    const auto from = static_cast<std::size_t>(order[i]);
    at[from] = static_cast<int>(i);
    Body& body = by_level.bodies[i] = model.bodies[from];
    if (body.parent >= 0) body.parent = at[static_cast<std::size_t>(body.parent)];
  }
  for (int k = 0; k < 20; ++k) {
    const Vector q = random.vector(n, 3);
    const Matrix M = mass_matrix(model, q);
    // The same sums in another order.
    EXPECT_LT((mass_matrix(by_level, q) - M).cwiseAbs().maxCoeff(),
              8 * eps * static_cast<double>(model.bodies.size()) * M.cwiseAbs().maxCoeff());
  }
}

TEST(MassMatrixOfTheTwoLinkArm, HasTheExtremeEigenvaluesOfTheLiterature) {
  // To the six decimals printed; extremes over q2 are at 0 (largest) and found on a fine grid.
  for (const auto& [mp, low, high] :
       {std::tuple{0.0, 0.447361, 9.962639}, std::tuple{0.5, 0.657145, 12.252855}}) {
    const Model model = testing::two_link(mp);
    double least = 1e9, most = 0;
    for (int k = 0; k <= 3600; ++k) {
      const Vector q{{0.4, k * 3.14159265358979323846 / 1800}};
      const auto lambda =
          Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(mass_matrix(model, q)).eigenvalues();
      least = std::min(least, lambda[0]);
      most = std::max(most, lambda[1]);
    }
    EXPECT_NEAR(least, low, 1e-6);
    EXPECT_NEAR(most, high, 1e-6);
  }
}

}  // namespace
}  // namespace tachless::robot

#include "identify/physical_inertia.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <random>
#include <vector>

#include "tests/analysis/identify/hidden_arm.h"

namespace tachless::identify {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::VectorXd;

const scenario::Scenario& arm() {
  static const scenario::Scenario two_link = scenario("practical_rigid", "20", 2);
  return two_link;
}

/// Returns x'N x / 2 - b'x.
double cost(const MatrixXd& N, const VectorXd& b, const VectorXd& x) {
  return 0.5 * x.dot(N * x) - b.dot(x);
}

/// Returns the least cost of all x >= 0: of the solutions for each choice of the numbers that are
/// not zero, the best one that is not negative.
double least_cost(const MatrixXd& N, const VectorXd& b) {
  double least = 0;
  for (unsigned choice = 1; choice < 1U << b.size(); ++choice) {
    std::vector<Index> free;
    for (Index i = 0; i < b.size(); ++i) {
      if ((choice >> i & 1U) != 0) free.push_back(i);
    }
    const MatrixXd own = N(free, free);
    const VectorXd x = own.ldlt().solve(VectorXd(b(free)));
    if (x.minCoeff() >= 0) least = std::min(least, cost(own, b(free), x));
  }
  return least;
}

TEST(PossibleValues, OfFrictionAreTheBestThatAreNotNegative) {
  const Parameters parameters(arm(), {Kind::rotor, Kind::viscous, Kind::coulomb});
  const Index size = parameters.size();
  ASSERT_EQ(size, 6);
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  int at_bound = 0;
  for (int draw = 0; draw < 50; ++draw) {
    const MatrixXd rows = MatrixXd::NullaryExpr(20, size, [&] { return normal(random); });
    const MatrixXd N = rows.transpose() * rows;
    const VectorXd b = VectorXd::NullaryExpr(size, [&] { return 20 * normal(random); });
    const VectorXd x = possible_values(N, b, parameters, *arm().model).values;
    EXPECT_GE(x.minCoeff(), 0);
    // The search ends when a step lowers the cost by less than 1e-12 of it.
    const double least = least_cost(N, b);
    EXPECT_NEAR(cost(N, b, x), least, 1e-9 * (1 - least));
    at_bound += x.minCoeff() == 0 ? 1 : 0;
  }
  EXPECT_GT(at_bound, 25);
}

/// Data that say nothing leave the model's links as they are.
TEST(PossibleValues, OfLinksWithoutDataAreTheModels) {
  const Parameters parameters(arm(), {Kind::inertia});
  const Index size = parameters.size();
  const VectorXd x =
      possible_values(MatrixXd::Zero(size, size), VectorXd::Zero(size), parameters, *arm().model)
          .values;
  // Inertia is added until the pseudo-inertia has a factor: 1e-10 m2 times the mass and more.
  EXPECT_LT(x.cwiseAbs().maxCoeff(), 1e-6);
}

/// Data that ask for a link of -5 kg, and for an inertia of a line that is thicker than it is long.
TEST(PossibleValues, OfLinksArePhysicallyPossible) {
  const Parameters parameters(arm(), {Kind::inertia});
  const Index size = parameters.size();
  VectorXd asked = VectorXd::Zero(size);
  const Inertial own = inertial_of(arm().model->bodies[0]);
  asked[0] = -5 - own[0];
  asked[14] = 10;
  const MatrixXd N = 1e4 * MatrixXd::Identity(size, size);
  const PossibleValues found = possible_values(N, N * asked, parameters, *arm().model);
  for (std::size_t body = 0; body < 2; ++body) {
    const Inertial link = inertial_of(arm().model->bodies[body]) +
                          found.values.segment<10>(10 * static_cast<Index>(body));
    EXPECT_GT(link[0], 0);
    Matrix3d I;
    I << link[4], link[7], link[8], link[7], link[5], link[9], link[8], link[9], link[6];
    Eigen::Matrix4d pseudo;
    pseudo << 0.5 * I.trace() * Matrix3d::Identity() - I, link.segment<3>(1),
        link.segment<3>(1).transpose(), link[0];
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> eigen(pseudo);
    EXPECT_GT(eigen.eigenvalues().minCoeff(), -1e-12 * eigen.eigenvalues().maxCoeff());
  }
  EXPECT_EQ(found.prior.rows(), size);
}

}  // namespace
}  // namespace tachless::identify

#include "lyapunov/error_system.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "robot/dynamics.h"
#include "tests/analysis/linear/loops.h"
#include "tests/analysis/lyapunov/decrease.h"

namespace tachless::lyapunov {
namespace {

using namespace linear;
using namespace linear::testing;
using namespace lyapunov::testing;
using Eigen::VectorXd;

/// V of its definition, term by term, and its derivative along the error equation by the product
/// rule, with Mdot from jets: nothing of it is shared with decrease_matrix.
struct Independent {
  double V = 0, Vdot = 0;
  double size = 0;  ///< of the terms of Vdot that cancel
};
Independent independent(const robot::Model& model, const ErrorSystem& s, const Weights& w,
                        const Vector& q, const Vector& v_ref, const VectorXd& z) {
  const Eigen::Index N = s.num_errors(), n = s.num_links();
  const VectorXd e = z.head(N), nu = z.segment(N, N), edot = z.tail(N);
  const Vector v = v_ref + Vector(edot.head(n));
  const Vector zero = Vector::Zero(n);
  const auto jets = robot::mass_matrix(model, robot::jet(q, v, zero));
  Eigen::MatrixXd M = Eigen::MatrixXd::Zero(N, N), Mdot = M, C = M;
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j < n; ++j) {
      M(i, j) = jets(i, j).value;
      Mdot(i, j) = jets(i, j).first;
    }
  }
  for (Eigen::Index i = n; i < N; ++i) M(i, i) = s.rotor_inertia[i - n];
  C.topLeftCorner(n, n) =
      robot::coriolis_matrix(model, q, v) + robot::coriolis_matrix(model, q, v_ref);
  if (s.damping.size() > 0) C.topLeftCorner(n, n).diagonal() += s.damping;
  const VectorXd M_eddot = -C * edot - s.kp * e - s.kd * nu;
  const VectorXd nudot = s.b.cwiseProduct(edot) - s.a.cwiseProduct(nu);
  const Eigen::MatrixXd by_b = s.b.cwiseInverse().asDiagonal();
  const auto [eps_1, eps_2] = w.of(N);
  const VectorXd cross = eps_1.cwiseProduct(e) - eps_2.cwiseProduct(nu);
  const VectorXd cross_dot = eps_1.cwiseProduct(edot) - eps_2.cwiseProduct(nudot);
  Independent result;
  result.V = edot.dot(M * edot) / 2 + e.dot(s.kp * e) / 2 + nu.dot(s.kd * by_b * nu) / 2 +
             cross.dot(M * edot);
  const double terms[] = {edot.dot(M_eddot),
                          edot.dot(Mdot * edot) / 2,
                          e.dot(s.kp * edot),
                          nu.dot(s.kd * by_b * nudot),
                          cross_dot.dot(M * edot),
                          cross.dot(Mdot * edot),
                          cross.dot(M_eddot),
                          s.kp_dot.size() > 0 ? e.dot(s.kp_dot * e) / 2 : 0,
                          s.kp_dot.size() > 0 ? nu.dot(s.kd_dot * by_b * nu) / 2 : 0};
  for (const double term : terms) {
    result.Vdot += term;
    result.size += std::abs(term);
  }
  return result;
}

void expect_identity(const robot::Model& model, const ErrorSystem& system, unsigned seed) {
  robot::testing::Random random(seed);
  const Eigen::Index N = system.num_errors(), n = system.num_links();
  for (int i = 0; i < 500; ++i) {
    const double eps = random.uniform(0.001, 0.1);
    const VectorXd each = VectorXd::NullaryExpr(N, [&] { return random.uniform(0.2, 5); });
    for (const Weights& w : {Weights{eps, eps}, Weights{random.uniform(0, 30), eps},
                             Weights{6 * each, eps * each.reverse()}}) {
      const Vector q = random.vector(n, std::numbers::pi), v_ref = random.vector(n, 2);
      VectorXd z(3 * N);
      for (Eigen::Index k = 0; k < 3 * N; ++k) z[k] = random.uniform(-1, 1);
      const VectorXd delta = (delta_of(system, w) * z.head(2 * N)).head(n);
      const numerics::Inertia at = numerics::inertia_at(model, q);
      const Independent expected = independent(model, system, w, q, v_ref, z);
      const double Vdot = -z.dot(decrease_matrix(system, w, at, v_ref, delta) * z);
      // Rounding: sums of some hundred products, each exact to 1e-16 of its size.
      ASSERT_NEAR(Vdot, expected.Vdot, 1e-13 * expected.size);
      ASSERT_NEAR(z.dot(lyapunov_matrix(system, w, at.M) * z) / 2, expected.V,
                  1e-12 * std::abs(expected.V) + 1e-12 * z.squaredNorm() * system.kp.norm());
    }
  }
}

TEST(ErrorSystem, VdotIsTheQuadraticFormForTwoRigidJoints) {
  expect_identity(robot::testing::two_link(0.5), linear::testing::rigid(paper_rigid()), 1);
}
TEST(ErrorSystem, VdotIsTheQuadraticFormForTwoFlexibleJoints) {
  expect_identity(robot::testing::two_link(),
                  linear::testing::flexible(practical_link(), practical_motor()), 2);
}
TEST(ErrorSystem, VdotIsTheQuadraticFormForSevenRigidJoints) {
  expect_identity(robot::testing::iiwa7(), linear::testing::rigid(iiwa_gains()), 3);
}
TEST(ErrorSystem, VdotIsTheQuadraticFormForSevenFlexibleJoints) {
  const FilterGains link = iiwa_gains();
  FilterGains motor = link;
  motor.kd *= 0.1;
  const VectorXd one = VectorXd::Ones(7);
  expect_identity(robot::testing::iiwa7(),
                  flexible_error_system(1e4 * one, 0.05 * one, link, motor), 4);
}
TEST(ErrorSystem, VdotIsTheQuadraticFormForABranchingRobotWithPrismaticJoints) {
  const robot::Model model = robot::testing::branching();
  const VectorXd one = VectorXd::Ones(model.num_joints);
  expect_identity(model, linear::testing::rigid({500 * one, 50 * one, 100 * one, 150 * one}), 5);
}

/// A symmetric matrix with positive eigenvalues of the size of `diagonal`.
Eigen::MatrixXd coupled(const VectorXd& diagonal, unsigned seed) {
  robot::testing::Random random(seed);
  const VectorXd v = random.vector(diagonal.size(), 1);
  const VectorXd root = diagonal.cwiseSqrt();
  return root.asDiagonal() * (Eigen::MatrixXd::Identity(v.size(), v.size()) + v * v.transpose()) *
         root.asDiagonal();
}

TEST(ErrorSystem, VdotIsTheQuadraticFormForMatricesAndViscousFriction) {
  ErrorSystem two{coupled(both(4000, 2400), 6),
                  coupled(both(1000, 60), 7),
                  both(300),
                  both(500),
                  {},
                  both(20, 3)};
  expect_identity(robot::testing::two_link(0.5), two, 8);
  const FilterGains g = iiwa_gains();
  ErrorSystem seven{coupled(g.kp, 9), coupled(g.kd, 10), g.a, 2 * g.b, {}, 0.1 * g.kd};
  expect_identity(robot::testing::iiwa7(), seven, 11);
}

}  // namespace
}  // namespace tachless::lyapunov

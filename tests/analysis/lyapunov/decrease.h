#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include "lyapunov/matrix_condition.h"
#include "numerics/decompositions.h"
#include "tests/core/robot/robots.h"

/// The derivative of V, and the matrix condition by another way.
namespace tachless::lyapunov::testing {

/// A loop of n joints and weights of V at random.
struct RandomLoop {
  RandomLoop(robot::testing::Random& random, Eigen::Index n) {
    const auto positive = [&](double most) -> Eigen::VectorXd {
      return Eigen::VectorXd(random.vector(n, most).cwiseAbs().array() + 0.01 * most);
    };
    system = {positive(5e3).asDiagonal(),
              positive(300).asDiagonal(),
              positive(1000),
              positive(1000),
              {},
              positive(2)};
    weights = {positive(20), positive(0.2)};
  }

  ErrorSystem system;
  Weights weights;
};

/// C(q, x).
inline Eigen::MatrixXd coriolis(const numerics::Inertia& inertia, const Eigen::VectorXd& x) {
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(x.size(), x.size());
  for (Eigen::Index j = 0; j < x.size(); ++j) sum += x[j] * inertia.C[static_cast<std::size_t>(j)];
  return sum;
}

/// The whole of Mm: Vdot = -x' Mm x.
inline Eigen::MatrixXd decrease_matrix(const ErrorSystem& system, const Weights& weights,
                                       const numerics::Inertia& inertia,
                                       const Eigen::VectorXd& v_ref, const Eigen::VectorXd& delta) {
  const Eigen::Index N = system.num_errors(), n = system.num_links();
  Eigen::MatrixXd Mm = decrease_constant(system, weights) +
                       decrease_of_inertia(system, weights, inertia.M) +
                       decrease_of_coriolis(system, weights, coriolis(inertia, v_ref));
  const Eigen::MatrixXd C = coriolis(inertia, delta);
  Mm.block(2 * N, 2 * N, n, n) -= 0.5 * (C + C.transpose());
  return Mm;
}

/// Returns values and vectors, A vectors = B vectors diag(values) and vectors' B vectors = 1, of a
/// symmetric A and a positive definite B.
inline numerics::SymmetricEigen generalized_eigen(const Eigen::MatrixXd& A,
                                                  const Eigen::MatrixXd& B) {
  const numerics::SymmetricEigen of_B = numerics::symmetric_eigen(B);
  const Eigen::MatrixXd whitening =
      of_B.vectors * of_B.values.cwiseSqrt().cwiseInverse().asDiagonal();
  numerics::SymmetricEigen eigen = numerics::symmetric_eigen(whitening.transpose() * A * whitening);
  eigen.vectors = whitening * eigen.vectors;
  return eigen;
}

/// The corners of a regular polygon around the disc.
inline std::vector<Eigen::VectorXd> polygon(double radius, int sides) {
  std::vector<Eigen::VectorXd> corners;
  for (int k = 0; k < sides; ++k) {
    const double angle = 2 * std::numbers::pi * k / sides;
    corners.emplace_back(radius / std::cos(std::numbers::pi / sides) *
                         Eigen::Vector2d(std::cos(angle), std::sin(angle)));
  }
  return corners;
}

/// The largest |delta|^2 / (2 V), of V's whole matrix.
inline double delta_by_V(const ErrorSystem& system, const Weights& weights,
                         const numerics::Inertia& inertia) {
  const Eigen::Index N = system.num_errors(), n = system.num_links();
  const auto [eps_1, eps_2] = weights.of(N);
  Eigen::MatrixXd of_x = Eigen::MatrixXd::Zero(n, 3 * N);
  of_x.leftCols(n).diagonal() = eps_1.head(n);
  of_x.middleCols(N, n).diagonal() = -eps_2.head(n);
  const Eigen::MatrixXd P = lyapunov_matrix(system, weights, inertia.M);
  return numerics::largest_eigenvalue(of_x * numerics::inverse(P) * of_x.transpose());
}

/// The condition for two joints with polygons around v_ref and delta in place of sums of squares.
/// It is positive at the corners, hence inside. The norm of delta is the Euclidean one. The
/// condition covers the postures of `condition` alone.
class PolygonCondition {
 public:
  PolygonCondition(MatrixCondition condition, int sides)
      : condition_(std::move(condition)),
        v_ref_(polygon(condition_.B_d, sides)),
        delta_(polygon(1, sides)) {}

  /// Only rho, level and ball.
  [[nodiscard]] std::optional<Region> region(const Weights& weights) const {
    double largest = 0;  // of delta's part of Mm over the rest, at |delta| = 1
    for_each_corner(weights, [&](const numerics::Inertia& inertia, const Eigen::MatrixXd& Mm) {
      const Eigen::MatrixXd none = at(weights, inertia, {});
      for (const Eigen::VectorXd& delta : delta_) {
        const Eigen::MatrixXd D = none - at(weights, inertia, delta);
        largest = std::max(largest, eigenvalues(D, Mm).maxCoeff());
      }
    });
    Region region;
    region.rho = 1 / largest;
    double w = 0, alpha_2 = 0;
    for (const numerics::Inertia& inertia : condition_.postures.inertia) {
      const ErrorSystem& system = condition_.systems[0];
      w = std::max(w, delta_by_V(system, weights, inertia));
      alpha_2 = std::max(
          alpha_2, numerics::largest_eigenvalue(lyapunov_matrix(system, weights, inertia.M)) / 2);
    }
    region.level = region.rho * region.rho / (2 * w);
    region.ball = std::sqrt(region.level / alpha_2);
    return region;
  }

  /// Returns the rate at which V falls, at delta = 0.
  [[nodiscard]] double rate(const Weights& weights) const {
    double least = std::numeric_limits<double>::infinity();
    for_each_corner(weights, [&](const numerics::Inertia& inertia, const Eigen::MatrixXd& Mm) {
      const Eigen::MatrixXd P = lyapunov_matrix(condition_.systems[0], weights, inertia.M);
      least = std::min(least, eigenvalues(Mm, P / 2).minCoeff());
    });
    return least;
  }

 private:
  static Eigen::VectorXd eigenvalues(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B) {
    return generalized_eigen(A, B).values;
  }
  [[nodiscard]] Eigen::MatrixXd at(const Weights& weights, const numerics::Inertia& inertia,
                                   const Eigen::VectorXd& delta,
                                   const Eigen::VectorXd& v_ref = Eigen::Vector2d::Zero()) const {
    return decrease_matrix(condition_.systems[0], weights, inertia, v_ref,
                           delta.size() == 0 ? Eigen::VectorXd(Eigen::Vector2d::Zero()) : delta);
  }
  template <class F>
  void for_each_corner(const Weights& weights, const F& f) const {
    for (const numerics::Inertia& inertia : condition_.postures.inertia) {
      for (const Eigen::VectorXd& v : v_ref_) f(inertia, at(weights, inertia, {}, v));
    }
  }

  MatrixCondition condition_;
  std::vector<Eigen::VectorXd> v_ref_, delta_;
};

}  // namespace tachless::lyapunov::testing

#include "certificate/matrix_condition.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "certificate/constants.h"

namespace tachless::certificate {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double infinity = std::numeric_limits<double>::infinity();
/// rho is certified strictly below the value at which Mm turns singular.
constexpr double strictly_below = 1 - 1e-9;

MatrixXd symmetric_part(const MatrixXd& A) { return (A + A.transpose()) / 2; }

/// The square root of sum A_j^2, symmetric A_j: -R <= sum x_j A_j <= R for |x| <= 1, by the
/// operator Cauchy-Schwarz inequality and because the square root is operator monotone.
MatrixXd root_of_squares(const std::vector<MatrixXd>& A) {
  MatrixXd sum = MatrixXd::Zero(A[0].rows(), A[0].cols());
  for (const MatrixXd& a : A) sum.noalias() += a * a;
  const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(sum);
  return solver.eigenvectors() * solver.eigenvalues().cwiseMax(0).cwiseSqrt().asDiagonal() *
         solver.eigenvectors().transpose();
}

/// The same after a congruence by the diagonal matrix `scale`, undone afterwards.
MatrixXd root_of_squares_scaled(std::vector<MatrixXd> A, const VectorXd& scale) {
  const VectorXd inverse = scale.cwiseInverse();
  for (MatrixXd& a : A) a = (inverse.asDiagonal() * a * inverse.asDiagonal()).eval();
  return scale.asDiagonal() * root_of_squares(A) * scale.asDiagonal();
}

/// The congruence L^-1 A L^-T.
MatrixXd whitened(const Eigen::LLT<MatrixXd>& llt, const MatrixXd& A) {
  const MatrixXd left = llt.matrixL().solve(A);
  return symmetric_part(llt.matrixL().solve(left.transpose()));
}

}  // namespace

/// Extremes of V over the postures.
struct MatrixCondition::Shape {
  double w = 0;
  double alpha_2 = 0;
  VectorXd inertia;    ///< largest M_ii
  VectorXd inverse_S;  ///< largest (S^-1)_ii of the position errors
};

VelocitySet VelocitySet::polygon(double radius, int sides) {
  VelocitySet set;
  set.radius = radius / std::cos(std::numbers::pi / sides);
  for (int k = 0; k < sides; ++k) {
    const double angle = 2 * std::numbers::pi * k / sides;
    set.vertices.push_back(set.radius * Eigen::Vector2d(std::cos(angle), std::sin(angle)));
  }
  return set;
}

VelocitySet VelocitySet::box(const VectorXd& bound) {
  VelocitySet set;
  set.radius = bound.norm();
  for (std::size_t corner = 0; corner < std::size_t{1} << bound.size(); ++corner) {
    VectorXd v = bound;
    for (Index i = 0; i < v.size(); ++i) {
      if ((corner >> i & 1U) != 0) v[i] = -v[i];
    }
    set.vertices.push_back(v);
  }
  return set;
}

MatrixCondition::MatrixCondition(ErrorSystem system, const Postures& postures, VelocitySet v_ref,
                                 const MatrixOptions& options)
    : system_(std::move(system)),
      postures_(&postures),
      v_ref_(std::move(v_ref)),
      largest_v_ref_(v_ref_.vertices.empty() ? v_ref_.radius : 0),
      options_(options) {
  for (const VectorXd& v : v_ref_.vertices) largest_v_ref_ = std::max(largest_v_ref_, v.norm());
}

MatrixCondition::Slack MatrixCondition::slack(const Weights& weights) const {
  const Index N = system_.num_errors(), n = system_.num_links();
  Slack result{MatrixXd::Zero(n, n), MatrixXd::Zero(3 * N, 3 * N), MatrixXd::Zero(n, n)};
  if (postures_->harmonics().empty()) return result;
  // Sizes of Mm's and M's rows, so that a bound on one does not spoil another.
  const Inertia& first = postures_->at(0);
  const VectorXd scale_M = first.M.diagonal().cwiseSqrt();
  const VectorXd scale =
      (decrease_constant(system_, weights) + decrease_of_inertia(system_, weights, first.M))
          .diagonal()
          .cwiseAbs()
          .cwiseMax(1e-300)
          .cwiseSqrt();
  const double f = postures_->chord_factor();
  for (const Postures::Harmonic& h : postures_->harmonics()) {
    const double curvature = f * h.order * h.order;
    const std::vector<MatrixXd> of_C = [&] {
      std::vector<MatrixXd> all;
      for (const Inertia* part : {&h.cosine, &h.sine}) {
        for (const MatrixXd& C : part->C) all.push_back(symmetric_part(C));
      }
      return all;
    }();
    std::vector<MatrixXd> of_decrease;
    for (const Inertia* part : {&h.cosine, &h.sine}) {
      for (const MatrixXd& C : part->C) {
        of_decrease.push_back(decrease_of_coriolis(system_, weights, C));
      }
    }
    result.M += curvature * root_of_squares_scaled({h.cosine.M, h.sine.M}, scale_M);
    result.decrease +=
        curvature * root_of_squares_scaled({decrease_of_inertia(system_, weights, h.cosine.M),
                                            decrease_of_inertia(system_, weights, h.sine.M)},
                                           scale);
    result.decrease += curvature * largest_v_ref_ * root_of_squares_scaled(of_decrease, scale);
    result.delta += curvature * root_of_squares_scaled(of_C, scale_M);
  }
  return result;
}

/// Matrices all of which are positive definite only when Mm is at delta = 0 for every v_ref of the
/// set; empty when a congruence fails, and then it is not.
std::vector<MatrixXd> MatrixCondition::decrease_at(const Weights& weights, const Inertia& inertia,
                                                   const Slack& slack) const {
  const MatrixXd at_rest = decrease_constant(system_, weights) +
                           decrease_of_inertia(system_, weights, inertia.M) - slack.decrease;
  if (!v_ref_.vertices.empty()) {
    std::vector<MatrixXd> result;
    for (const VectorXd& v : v_ref_.vertices) {
      result.push_back(at_rest + decrease_of_coriolis(system_, weights, inertia.coriolis(v)));
    }
    return result;
  }
  if (v_ref_.radius == 0) return {at_rest};
  const Eigen::LLT<MatrixXd> llt(at_rest);
  if (llt.info() != Eigen::Success) return {};
  std::vector<MatrixXd> scaled;
  for (const MatrixXd& C : inertia.C) {
    scaled.push_back(whitened(llt, decrease_of_coriolis(system_, weights, C)));
  }
  const MatrixXd L = llt.matrixL();
  return {at_rest - v_ref_.radius * (L * root_of_squares(scaled) * L.transpose())};
}

double MatrixCondition::rho_at(const Weights& weights, const Inertia& inertia,
                               const Slack& slack) const {
  const Index N = system_.num_errors(), n = system_.num_links();
  const std::vector<MatrixXd> all = decrease_at(weights, inertia, slack);
  if (all.empty()) return 0;
  double rho = infinity;
  for (const MatrixXd& F : all) {
    const Eigen::LLT<MatrixXd> llt(F);
    if (llt.info() != Eigen::Success) return 0;
    // F - rho E D E' > 0 exactly when rho lambda_max(H' D H) < 1, H H' = E' F^-1 E.
    const MatrixXd E = MatrixXd::Identity(3 * N, 3 * N).middleCols(2 * N, n);
    const Eigen::LLT<MatrixXd> root(llt.solve(E).middleRows(2 * N, n));
    const MatrixXd H = root.matrixL();
    std::vector<MatrixXd> scaled;
    for (const MatrixXd& C : inertia.C) {
      scaled.push_back(H.transpose() * symmetric_part(C) * H);
    }
    double largest = 0;
    if (options_.delta_sides > 0 && n == 2) {
      const int sides = options_.delta_sides;
      for (int k = 0; k < sides; ++k) {
        const double angle = 2 * std::numbers::pi * k / sides;
        largest = std::max(
            largest, largest_eigenvalue(std::cos(angle) * scaled[0] + std::sin(angle) * scaled[1]));
      }
      largest /= std::cos(std::numbers::pi / sides);
    } else {
      MatrixXd sum = MatrixXd::Zero(n, n);
      for (const MatrixXd& s : scaled) sum.noalias() += s * s;
      largest = std::sqrt(std::max(0.0, largest_eigenvalue(sum)));
    }
    largest += largest_eigenvalue(H.transpose() * slack.delta * H);
    rho = std::min(rho, strictly_below / std::max(largest, 1e-300));
  }
  return rho;
}

double MatrixCondition::rate_at(const Weights& weights, double rho, const Inertia& inertia,
                                const Slack& slack) const {
  const Index N = system_.num_errors(), n = system_.num_links();
  // P of the posture, enlarged by what it may be in between.
  MatrixXd P = lyapunov_matrix(system_, weights, inertia.M);
  const Eigen::LLT<MatrixXd> positive(P);
  if (positive.info() != Eigen::Success) return -infinity;
  const double gap = spectral_norm(slack.M) * (1 + std::hypot(weights.eps_1, weights.eps_2));
  P.diagonal().array() += gap;
  const Eigen::LLT<MatrixXd> half_P(P / 2);
  const std::vector<MatrixXd> all = decrease_at(weights, inertia, slack);
  if (all.empty()) {
    // Not certified; how far from it, to guide a search.
    const MatrixXd F = decrease_constant(system_, weights) +
                       decrease_of_inertia(system_, weights, inertia.M) - slack.decrease;
    return std::min(0.0, smallest_eigenvalue(whitened(half_P, F)));
  }
  double rate = infinity;
  const auto corner = [&](MatrixXd F, const MatrixXd& D) {
    F.block(2 * N, 2 * N, n, n) -= rho * D;
    rate = std::min(rate, smallest_eigenvalue(whitened(half_P, F)));
  };
  for (const MatrixXd& F : all) {
    if (rho == 0) {
      rate = std::min(rate, smallest_eigenvalue(whitened(half_P, F)));
    } else if (options_.delta_sides > 0 && n == 2) {
      const int sides = options_.delta_sides;
      for (int k = 0; k < sides; ++k) {
        const double angle = 2 * std::numbers::pi * k / sides;
        corner(F,
               symmetric_part(inertia.coriolis(Eigen::Vector2d(std::cos(angle), std::sin(angle)))) /
                       std::cos(std::numbers::pi / sides) +
                   slack.delta);
      }
    } else {
      std::vector<MatrixXd> symmetric;
      for (const MatrixXd& C : inertia.C) symmetric.push_back(symmetric_part(C));
      corner(F, root_of_squares_scaled(symmetric, inertia.M.diagonal().cwiseSqrt()) + slack.delta);
    }
  }
  return rate;
}

/// S is antitone and its inverse convex in M, so that the extremes over a chord, enlarged by the
/// slack, are at its ends.
std::optional<MatrixCondition::Shape> MatrixCondition::shape(const Weights& weights,
                                                             const Slack& slack) const {
  const Index N = system_.num_errors(), n = system_.num_links();
  MatrixXd G(2 * N, N), links = MatrixXd::Zero(n, 2 * N);
  G << weights.eps_1 * MatrixXd::Identity(N, N), -weights.eps_2 * MatrixXd::Identity(N, N);
  links.leftCols(n) = weights.eps_1 * MatrixXd::Identity(n, n);
  links.middleCols(N, n) = -weights.eps_2 * MatrixXd::Identity(n, n);
  MatrixXd K = MatrixXd::Zero(2 * N, 2 * N);
  K.topLeftCorner(N, N) = system_.kp;
  K.bottomRightCorner(N, N) = system_.kd.cwiseQuotient(system_.b).asDiagonal();

  const auto inverse_S = [&](const Inertia& inertia) -> std::optional<MatrixXd> {
    const MatrixXd M = system_.inertia(inertia.M + slack.M);
    const Eigen::LLT<MatrixXd> llt(K - G * M * G.transpose());
    if (llt.info() != Eigen::Success) return {};
    return llt.solve(MatrixXd::Identity(2 * N, 2 * N));
  };
  const auto largest_over_postures = [&](const auto& f) {
    return -postures_
                ->smallest([&](const Inertia& inertia) { return -f(inertia); }, options_.refine)
                .value;
  };
  Shape result;
  result.w = largest_over_postures([&](const Inertia& inertia) {
    const auto S = inverse_S(inertia);
    return S ? largest_eigenvalue(links * *S * links.transpose()) : infinity;
  });
  if (std::isinf(result.w)) return {};
  result.alpha_2 = largest_over_postures([&](const Inertia& inertia) {
                     return largest_eigenvalue(lyapunov_matrix(system_, weights, inertia.M)) / 2;
                   }) +
                   spectral_norm(slack.M) * (1 + std::hypot(weights.eps_1, weights.eps_2)) / 2;
  result.inertia = VectorXd::Zero(N);
  result.inverse_S = VectorXd::Zero(N);
  for (std::size_t i = 0; i < postures_->size(); ++i) {
    const Inertia& inertia = postures_->at(i);
    const auto S = inverse_S(inertia);
    if (!S) return {};
    result.inertia = result.inertia.cwiseMax(system_.inertia(inertia.M + slack.M).diagonal());
    result.inverse_S = result.inverse_S.cwiseMax(S->diagonal().head(N));
  }
  return result;
}

std::optional<Region> MatrixCondition::region(const Weights& weights) const {
  const Slack between = slack(weights);
  const Postures::Least least = postures_->smallest(
      [&](const Inertia& inertia) { return rho_at(weights, inertia, between); }, options_.refine);
  if (!(least.value > 0)) return {};
  const auto V = shape(weights, between);
  if (!V) return {};
  Region region;
  region.rho = least.value;
  region.q = least.q;
  region.w = V->w;
  region.alpha_2 = V->alpha_2;
  region.level = V->w > 0 ? region.rho * region.rho / (2 * V->w) : infinity;
  region.ball = std::sqrt(region.level / V->alpha_2);
  const double diameter = std::sqrt(2 * region.level);
  region.e_at_rest = diameter * system_.kp.diagonal().cwiseInverse().cwiseSqrt();
  region.edot = diameter * V->inertia.cwiseInverse().cwiseSqrt();
  region.e_reached = diameter * V->inverse_S.cwiseSqrt();
  return region;
}

Postures::Least MatrixCondition::slowest(const Weights& weights, double rho) const {
  const Slack between = slack(weights);
  return postures_->smallest(
      [&](const Inertia& inertia) { return rate_at(weights, rho, inertia, between); },
      options_.refine);
}

MatrixCondition MatrixCondition::over(const Postures& postures) const {
  MatrixCondition other = *this;
  other.postures_ = &postures;
  return other;
}

double MatrixCondition::rho_of_ball(const Weights& weights, double ball) const {
  const auto V = shape(weights, slack(weights));
  return V ? ball * std::sqrt(2 * V->w * V->alpha_2) : infinity;
}

}  // namespace tachless::certificate

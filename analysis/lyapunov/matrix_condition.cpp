#include "lyapunov/matrix_condition.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>

#include "linear/linear_loop.h"
#include "numerics/decompositions.h"

namespace tachless::lyapunov {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// rho is certified strictly below the value at which Mm turns singular.
constexpr double strictly_below = 1 - 1e-9;

/// Returns the square root R of sum A_j^2, symmetric A_j: -R <= sum x_j A_j <= R for |x| <= 1. This
/// follows from the operator Cauchy-Schwarz inequality, because the square root is operator
/// monotone.
MatrixXd root_of_squares(const std::vector<MatrixXd>& A) {
  MatrixXd sum = MatrixXd::Zero(A[0].rows(), A[0].cols());
  for (const MatrixXd& a : A) sum.noalias() += a * a;
  const auto [values, vectors] = numerics::symmetric_eigen(sum);
  return vectors * values.cwiseMax(0).cwiseSqrt().asDiagonal() * vectors.transpose();
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

/// Bounds on the parts of matrices that may be missing between two postures.
struct Slack {
  MatrixXd M;         ///< of the links' M
  MatrixXd decrease;  ///< of Mm without delta
  MatrixXd delta;     ///< of sym C(q, delta), |delta|_L = 1

  /// Returns the bound for V's matrix.
  [[nodiscard]] double of_lyapunov(const Weights& weights) const {
    const auto size = weights.eps_1.array().square() + weights.eps_2.array().square();
    return numerics::spectral_norm(M) * (1 + std::sqrt(size.maxCoeff()));
  }
};

/// C(q, L x) = sum x_j of these.
std::vector<MatrixXd> combined(const std::vector<MatrixXd>& C, const MatrixXd& L) {
  if (L.size() == 0) return C;
  std::vector<MatrixXd> all;
  for (Index j = 0; j < L.cols(); ++j) {
    MatrixXd sum = MatrixXd::Zero(L.rows(), L.rows());
    for (Index i = 0; i < L.rows(); ++i) sum += L(i, j) * C[static_cast<std::size_t>(i)];
    all.push_back(std::move(sum));
  }
  return all;
}

/// sym C(q, delta) in the same way, |L^-1 delta| = |x|.
std::vector<MatrixXd> coriolis_of_delta(const numerics::Inertia& inertia, const MatrixXd& L) {
  std::vector<MatrixXd> all = combined(inertia.C, L);
  for (MatrixXd& C : all) C = symmetric_part(C);
  return all;
}

/// Mm with neither v_ref nor delta.
MatrixXd decrease_at_rest(const ErrorSystem& system, const Weights& weights, const MatrixXd& M) {
  return decrease_constant(system, weights) + decrease_of_inertia(system, weights, M);
}

Slack slack_of(const MatrixCondition& condition, const ErrorSystem& system,
               const Weights& weights) {
  const numerics::Postures& postures = condition.postures;
  const Index N = system.num_errors(), n = system.num_links();
  Slack result{MatrixXd::Zero(n, n), MatrixXd::Zero(3 * N, 3 * N), MatrixXd::Zero(n, n)};
  if (postures.harmonics.empty()) return result;
  // Sizes of Mm's and M's rows, so that a bound on one does not spoil another.
  const MatrixXd& M = postures.inertia[0].M;
  const VectorXd scale_M = M.diagonal().cwiseSqrt();
  const VectorXd scale =
      decrease_at_rest(system, weights, M).diagonal().cwiseAbs().cwiseMax(1e-300).cwiseSqrt();
  for (const numerics::Postures::Harmonic& h : postures.harmonics) {
    const double curvature = postures.chord_factor * h.order * h.order;
    std::vector<MatrixXd> of_C, of_decrease;
    for (const numerics::Inertia* part : {&h.cosine, &h.sine}) {
      for (const MatrixXd& C : combined(part->C, condition.v_scale)) {
        of_decrease.push_back(decrease_of_coriolis(system, weights, C));
      }
      for (MatrixXd& C : coriolis_of_delta(*part, delta_scale(system, weights))) {
        of_C.push_back(std::move(C));
      }
    }
    result.M += curvature * root_of_squares_scaled({h.cosine.M, h.sine.M}, scale_M);
    result.decrease +=
        curvature * root_of_squares_scaled({decrease_of_inertia(system, weights, h.cosine.M),
                                            decrease_of_inertia(system, weights, h.sine.M)},
                                           scale);
    result.decrease += curvature * condition.B_d * root_of_squares_scaled(of_decrease, scale);
    result.delta += curvature * root_of_squares_scaled(of_C, scale_M);
  }
  return result;
}

/// Returns a matrix that is positive definite only if Mm at delta = 0 is, for every v_ref of the
/// condition. Returns nothing when the congruence fails; Mm is then not positive definite.
std::optional<MatrixXd> decrease_at(const MatrixCondition& condition, const ErrorSystem& system,
                                    const Weights& weights, const numerics::Inertia& inertia,
                                    const Slack& slack) {
  const MatrixXd at_rest = decrease_at_rest(system, weights, inertia.M) - slack.decrease;
  if (condition.B_d == 0) return at_rest;
  if (system.v_ref.size() > 0) {  // known
    const MatrixXd Cd = combined(inertia.C, system.v_ref)[0];
    return at_rest + decrease_of_coriolis(system, weights, Cd);
  }
  const Eigen::LLT<MatrixXd> llt(at_rest);
  if (llt.info() != Eigen::Success) return {};
  std::vector<MatrixXd> scaled;
  for (const MatrixXd& C : combined(inertia.C, condition.v_scale)) {
    scaled.push_back(whitened(llt, decrease_of_coriolis(system, weights, C)));
  }
  const MatrixXd L = llt.matrixL();
  return at_rest - condition.B_d * (L * root_of_squares(scaled) * L.transpose());
}

/// How many states that bind are given: the eigenvalues near the least one.
constexpr Index few = 3;

/// Returns rho at a posture.
/// @param states receives the states that bind rho, if it is given
double rho_at(const MatrixCondition& condition, const ErrorSystem& system, const Weights& weights,
              const numerics::Inertia& inertia, const Slack& slack, MatrixXd* states = nullptr) {
  const Index N = system.num_errors(), n = system.num_links();
  const auto F = decrease_at(condition, system, weights, inertia, slack);
  if (!F) return 0;
  const Eigen::LLT<MatrixXd> llt(*F);
  if (llt.info() != Eigen::Success) return 0;
  // F - rho E D E' > 0 exactly when rho lambda_max(H' D H) < 1, H H' = E' F^-1 E.
  const MatrixXd E = MatrixXd::Identity(3 * N, 3 * N).middleCols(2 * N, n);
  const Eigen::LLT<MatrixXd> root(llt.solve(E).middleRows(2 * N, n));
  const MatrixXd H = root.matrixL();
  MatrixXd sum = MatrixXd::Zero(n, n);
  for (const MatrixXd& C : coriolis_of_delta(inertia, delta_scale(system, weights))) {
    const MatrixXd scaled = H.transpose() * C * H;
    sum.noalias() += scaled * scaled;
  }
  if (states != nullptr) {
    const MatrixXd u = numerics::symmetric_eigen(sum).vectors.rightCols(std::min(few, n));
    *states = llt.solve(E * root.matrixU().solve(u));
  }
  const double largest = std::sqrt(std::max(0.0, numerics::largest_eigenvalue(sum))) +
                         numerics::largest_eigenvalue(H.transpose() * slack.delta * H);
  return strictly_below / std::max(largest, 1e-300);
}

double rate_at(const MatrixCondition& condition, const ErrorSystem& system, const Weights& weights,
               double rho, const numerics::Inertia& inertia, const Slack& slack,
               MatrixXd* states = nullptr) {
  const Index N = system.num_errors(), n = system.num_links();
  // P of the posture, enlarged by its change up to the next posture.
  MatrixXd P = lyapunov_matrix(system, weights, inertia.M);
  const Eigen::LLT<MatrixXd> positive(P);
  if (positive.info() != Eigen::Success) return -infinity;
  P.diagonal().array() += slack.of_lyapunov(weights);
  const Eigen::LLT<MatrixXd> half_P(P / 2);
  auto F = decrease_at(condition, system, weights, inertia, slack);
  const bool certified = F.has_value();
  // Not certified: how far from it, to guide a search.
  if (!certified) F = decrease_at_rest(system, weights, inertia.M) - slack.decrease;
  if (certified && rho != 0) {
    // After the congruence by which rho is found: positive inside of it.
    const Eigen::LLT<MatrixXd> llt(*F);
    if (llt.info() != Eigen::Success) return -infinity;
    const MatrixXd E = MatrixXd::Identity(3 * N, 3 * N).middleCols(2 * N, n);
    const Eigen::LLT<MatrixXd> root(llt.solve(E).middleRows(2 * N, n));
    std::vector<MatrixXd> of_delta;
    for (const MatrixXd& C : coriolis_of_delta(inertia, delta_scale(system, weights))) {
      of_delta.push_back(root.matrixU() * C * root.matrixL());
    }
    const MatrixXd half = root.matrixU().solve(root_of_squares(of_delta));
    F->block(2 * N, 2 * N, n, n) -= rho * (root.matrixU().solve(half.transpose()) + slack.delta);
  }
  const MatrixXd scaled = whitened(half_P, *F);
  if (states != nullptr) {
    *states = half_P.matrixU().solve(numerics::symmetric_eigen(scaled).vectors.leftCols(few));
  }
  const double least = numerics::smallest_eigenvalue(scaled);
  return certified ? least : std::min(0.0, least);
}

/// Extremes of V over the postures.
struct Shape {
  double w = 0;
  double alpha_2 = 0;  ///< V <= alpha_2 |x|^2
  VectorXd inertia;    ///< largest M_ii
  VectorXd inverse_S;  ///< largest (S^-1)_ii of the position errors
  VectorXd feedback;   ///< largest g' S^-1 g of Kp e + Kd nu = g' (e, nu), of each joint
};

/// S is antitone and its inverse convex in M, so that the extremes over a chord, enlarged by the
/// slack, are at its ends.
std::optional<Shape> shape_of(const MatrixCondition& condition, const ErrorSystem& system,
                              const Weights& weights, const Slack& slack) {
  const Index N = system.num_errors();
  const MatrixXd G = delta_of(system, weights).transpose();
  const MatrixXd K = stiffness_of(system);
  const MatrixXd in_L = delta_scale(system, weights)
                            .triangularView<Eigen::Lower>()
                            .solve(G.leftCols(system.num_links()).transpose());

  const auto inverse_S = [&](const numerics::Inertia& inertia) -> std::optional<MatrixXd> {
    const MatrixXd M = system.inertia(inertia.M + slack.M);
    const Eigen::LLT<MatrixXd> llt(K - G * M * G.transpose());
    if (llt.info() != Eigen::Success) return {};
    return llt.solve(MatrixXd::Identity(2 * N, 2 * N));
  };
  const auto largest_over_postures = [&](const auto& f) {
    const auto negative = [&](const numerics::Inertia& inertia) { return -f(inertia); };
    return -condition.postures.smallest(negative, condition.refine).value;
  };
  Shape result;
  result.w = largest_over_postures([&](const numerics::Inertia& inertia) {
    const auto S = inverse_S(inertia);
    return S ? numerics::largest_eigenvalue(in_L * *S * in_L.transpose()) : infinity;
  });
  if (std::isinf(result.w)) return {};
  result.alpha_2 =
      largest_over_postures([&](const numerics::Inertia& inertia) {
        return numerics::largest_eigenvalue(lyapunov_matrix(system, weights, inertia.M)) / 2;
      }) +
      slack.of_lyapunov(weights) / 2;
  result.inertia = VectorXd::Zero(N);
  result.inverse_S = VectorXd::Zero(N);
  result.feedback = VectorXd::Zero(N);
  MatrixXd g(N, 2 * N);
  g << system.kp, system.kd;
  for (const numerics::Inertia& inertia : condition.postures.inertia) {
    const auto S = inverse_S(inertia);
    if (!S) return {};
    result.inertia = result.inertia.cwiseMax(system.inertia(inertia.M + slack.M).diagonal());
    result.inverse_S = result.inverse_S.cwiseMax(S->diagonal().head(N));
    result.feedback = result.feedback.cwiseMax((g * *S * g.transpose()).diagonal());
  }
  return result;
}

}  // namespace

MatrixXd delta_scale(const ErrorSystem& system, const Weights& weights) {
  const MatrixXd N = delta_of(system, weights).topRows(system.num_links());
  return (N * stiffness_of(system).llt().solve(N.transpose())).llt().matrixL();
}

std::optional<Region> MatrixCondition::region(const Weights& weights) const {
  numerics::Extreme least{infinity, {}};
  Shape V;
  for (const ErrorSystem& system : systems) {
    const Slack slack = slack_of(*this, system, weights);
    const numerics::Extreme of_system = postures.smallest(
        [&](const numerics::Inertia& inertia) {
          return rho_at(*this, system, weights, inertia, slack);
        },
        refine);
    if (!(of_system.value > 0)) return {};
    if (of_system.value < least.value) least = of_system;
    auto shape = shape_of(*this, system, weights, slack);
    if (!shape) return {};
    V.w = std::max(V.w, shape->w);
    V.alpha_2 = std::max(V.alpha_2, shape->alpha_2);
    V.inertia = shape->inertia;  // does not depend on the gains
    if (V.inverse_S.size() > 0) {
      shape->inverse_S = shape->inverse_S.cwiseMax(V.inverse_S);
      shape->feedback = shape->feedback.cwiseMax(V.feedback);
    }
    V.inverse_S = shape->inverse_S;
    V.feedback = shape->feedback;
  }
  Region region;
  region.rho = least.value;
  region.q = least.q;
  region.w = V.w;
  region.level = V.w > 0 ? region.rho * region.rho / (2 * V.w) : infinity;
  region.ball = std::sqrt(region.level / V.alpha_2);
  const double diameter = std::sqrt(2 * region.level);
  region.e_at_rest = diameter * systems[0].kp.diagonal().cwiseInverse().cwiseSqrt();
  region.edot = diameter * V.inertia.cwiseInverse().cwiseSqrt();
  region.e_reached = diameter * V.inverse_S.cwiseSqrt();
  region.feedback = V.feedback.cwiseSqrt();
  return region;
}

double MatrixCondition::at(Goal goal, const Weights& weights, const ErrorSystem& system,
                           const numerics::Inertia& inertia, MatrixXd& states) const {
  const Slack slack = slack_of(*this, system, weights);
  return goal == Goal::rate ? rate_at(*this, system, weights, 0, inertia, slack, &states)
                            : rho_at(*this, system, weights, inertia, slack, &states);
}

numerics::Extreme MatrixCondition::slowest(const Weights& weights, double rho) const {
  numerics::Extreme least{infinity, {}};
  for (const ErrorSystem& system : systems) {
    const Slack slack = slack_of(*this, system, weights);
    const numerics::Extreme of_system = postures.smallest(
        [&](const numerics::Inertia& inertia) {
          return rate_at(*this, system, weights, rho, inertia, slack);
        },
        refine);
    if (of_system.value < least.value) least = of_system;
  }
  return least;
}

}  // namespace tachless::lyapunov

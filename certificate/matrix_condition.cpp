#include "certificate/matrix_condition.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>

#include "certificate/linear_loop.h"
#include "robot/decompositions.h"

namespace tachless::certificate {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// rho is certified strictly below the value at which Mm turns singular.
constexpr double strictly_below = 1 - 1e-9;

MatrixXd symmetric_part(const MatrixXd& A) { return (A + A.transpose()) / 2; }

/// The square root of sum A_j^2, symmetric A_j: -R <= sum x_j A_j <= R for |x| <= 1, by the
/// operator Cauchy-Schwarz inequality and because the square root is operator monotone.
MatrixXd root_of_squares(const std::vector<MatrixXd>& A) {
  MatrixXd sum = MatrixXd::Zero(A[0].rows(), A[0].cols());
  for (const MatrixXd& a : A) sum.noalias() += a * a;
  const auto [values, vectors] = robot::symmetric_eigen(sum);
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

/// What may be missing between two postures.
struct Slack {
  MatrixXd M;         ///< of the links' M
  MatrixXd decrease;  ///< of Mm without delta
  MatrixXd delta;     ///< of sym C(q, delta), |delta| = 1

  /// Of V's matrix.
  [[nodiscard]] double of_lyapunov(const Weights& weights) const {
    return spectral_norm(M) * (1 + std::hypot(weights.eps_1, weights.eps_2));
  }
};

/// Mm with neither v_ref nor delta.
MatrixXd decrease_at_rest(const ErrorSystem& system, const Weights& weights, const MatrixXd& M) {
  return decrease_constant(system, weights) + decrease_of_inertia(system, weights, M);
}

Slack slack_of(const MatrixCondition& condition, const Weights& weights) {
  const ErrorSystem& system = condition.systems[0];
  const Postures& postures = condition.postures;
  const Index N = system.num_errors(), n = system.num_links();
  Slack result{MatrixXd::Zero(n, n), MatrixXd::Zero(3 * N, 3 * N), MatrixXd::Zero(n, n)};
  if (postures.harmonics.empty()) return result;
  // Sizes of Mm's and M's rows, so that a bound on one does not spoil another.
  const MatrixXd& M = postures.inertia[0].M;
  const VectorXd scale_M = M.diagonal().cwiseSqrt();
  const VectorXd scale =
      decrease_at_rest(system, weights, M).diagonal().cwiseAbs().cwiseMax(1e-300).cwiseSqrt();
  for (const Postures::Harmonic& h : postures.harmonics) {
    const double curvature = postures.chord_factor * h.order * h.order;
    std::vector<MatrixXd> of_C, of_decrease;
    for (const Inertia* part : {&h.cosine, &h.sine}) {
      for (const MatrixXd& C : part->C) {
        of_C.push_back(symmetric_part(C));
        of_decrease.push_back(decrease_of_coriolis(system, weights, C));
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

/// A matrix that is positive definite only when Mm is at delta = 0 for every |v_ref| <= B_d;
/// nothing when the congruence fails, and then it is not.
std::optional<MatrixXd> decrease_at(const MatrixCondition& condition, const ErrorSystem& system,
                                    const Weights& weights, const Inertia& inertia,
                                    const Slack& slack) {
  const MatrixXd at_rest = decrease_at_rest(system, weights, inertia.M) - slack.decrease;
  if (condition.B_d == 0) return at_rest;
  if (system.v_ref.size() > 0) {  // known
    MatrixXd Cd = MatrixXd::Zero(inertia.M.rows(), inertia.M.cols());
    for (Index j = 0; j < system.v_ref.size(); ++j) {
      Cd += system.v_ref[j] * inertia.C[static_cast<std::size_t>(j)];
    }
    return at_rest + decrease_of_coriolis(system, weights, Cd);
  }
  const Eigen::LLT<MatrixXd> llt(at_rest);
  if (llt.info() != Eigen::Success) return {};
  std::vector<MatrixXd> scaled;
  for (const MatrixXd& C : inertia.C) {
    scaled.push_back(whitened(llt, decrease_of_coriolis(system, weights, C)));
  }
  const MatrixXd L = llt.matrixL();
  return at_rest - condition.B_d * (L * root_of_squares(scaled) * L.transpose());
}

double rho_at(const MatrixCondition& condition, const ErrorSystem& system, const Weights& weights,
              const Inertia& inertia, const Slack& slack) {
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
  for (const MatrixXd& C : inertia.C) {
    const MatrixXd scaled = H.transpose() * symmetric_part(C) * H;
    sum.noalias() += scaled * scaled;
  }
  const double largest = std::sqrt(std::max(0.0, largest_eigenvalue(sum))) +
                         largest_eigenvalue(H.transpose() * slack.delta * H);
  return strictly_below / std::max(largest, 1e-300);
}

double rate_at(const MatrixCondition& condition, const ErrorSystem& system, const Weights& weights,
               double rho, const Inertia& inertia, const Slack& slack) {
  const Index N = system.num_errors(), n = system.num_links();
  // P of the posture, enlarged by what it may be in between.
  MatrixXd P = lyapunov_matrix(system, weights, inertia.M);
  const Eigen::LLT<MatrixXd> positive(P);
  if (positive.info() != Eigen::Success) return -infinity;
  P.diagonal().array() += slack.of_lyapunov(weights);
  const Eigen::LLT<MatrixXd> half_P(P / 2);
  auto F = decrease_at(condition, system, weights, inertia, slack);
  if (!F) {
    // Not certified; how far from it, to guide a search.
    const MatrixXd at_rest = decrease_at_rest(system, weights, inertia.M) - slack.decrease;
    return std::min(0.0, smallest_eigenvalue(whitened(half_P, at_rest)));
  }
  if (rho != 0) {
    std::vector<MatrixXd> symmetric;
    for (const MatrixXd& C : inertia.C) symmetric.push_back(symmetric_part(C));
    const MatrixXd D =
        root_of_squares_scaled(symmetric, inertia.M.diagonal().cwiseSqrt()) + slack.delta;
    F->block(2 * N, 2 * N, n, n) -= rho * D;
  }
  return smallest_eigenvalue(whitened(half_P, *F));
}

/// Extremes of V over the postures.
struct Shape {
  double w = 0;
  double alpha_2 = 0;  ///< V <= alpha_2 |x|^2
  VectorXd inertia;    ///< largest M_ii
  VectorXd inverse_S;  ///< largest (S^-1)_ii of the position errors
};

/// S is antitone and its inverse convex in M, so that the extremes over a chord, enlarged by the
/// slack, are at its ends.
std::optional<Shape> shape_of(const MatrixCondition& condition, const ErrorSystem& system,
                              const Weights& weights, const Slack& slack) {
  const Index N = system.num_errors(), n = system.num_links();
  MatrixXd G(2 * N, N), links = MatrixXd::Zero(n, 2 * N);
  G << weights.eps_1 * MatrixXd::Identity(N, N), -weights.eps_2 * MatrixXd::Identity(N, N);
  links.leftCols(n) = weights.eps_1 * MatrixXd::Identity(n, n);
  links.middleCols(N, n) = -weights.eps_2 * MatrixXd::Identity(n, n);
  MatrixXd K = MatrixXd::Zero(2 * N, 2 * N);
  K.topLeftCorner(N, N) = system.kp;
  K.bottomRightCorner(N, N) = system.kd_by_b();

  const auto inverse_S = [&](const Inertia& inertia) -> std::optional<MatrixXd> {
    const MatrixXd M = system.inertia(inertia.M + slack.M);
    const Eigen::LLT<MatrixXd> llt(K - G * M * G.transpose());
    if (llt.info() != Eigen::Success) return {};
    return llt.solve(MatrixXd::Identity(2 * N, 2 * N));
  };
  const auto largest_over_postures = [&](const auto& f) {
    const auto negative = [&](const Inertia& inertia) { return -f(inertia); };
    return -condition.postures.smallest(negative, condition.refine).value;
  };
  Shape result;
  result.w = largest_over_postures([&](const Inertia& inertia) {
    const auto S = inverse_S(inertia);
    return S ? largest_eigenvalue(links * *S * links.transpose()) : infinity;
  });
  if (std::isinf(result.w)) return {};
  result.alpha_2 = largest_over_postures([&](const Inertia& inertia) {
                     return largest_eigenvalue(lyapunov_matrix(system, weights, inertia.M)) / 2;
                   }) +
                   slack.of_lyapunov(weights) / 2;
  result.inertia = VectorXd::Zero(N);
  result.inverse_S = VectorXd::Zero(N);
  for (const Inertia& inertia : condition.postures.inertia) {
    const auto S = inverse_S(inertia);
    if (!S) return {};
    result.inertia = result.inertia.cwiseMax(system.inertia(inertia.M + slack.M).diagonal());
    result.inverse_S = result.inverse_S.cwiseMax(S->diagonal().head(N));
  }
  return result;
}

/// x = (log eps_2, log(eps_1 / eps_2)).
Weights weights_of(const VectorXd& x) {
  const double eps_2 = std::exp(x[0]);
  return {eps_2 * std::exp(x[1]), eps_2};
}

/// From the best two points of a coarse grid; infinite where nothing is found. Mm's second block is
/// positive only for eps_2 below a_i / b_i, and its third only for eps_1 / eps_2 below b_i.
Minimum search(const ErrorSystem& system, const std::function<double(const VectorXd&)>& f) {
  const double top = std::log(system.a.cwiseQuotient(system.b).minCoeff());
  const double ratio_top = std::log(system.b.minCoeff());
  std::vector<Minimum> starts;
  for (double below = 0.7; below < 14; below += 1.1) {
    for (double ratio_below = 0.7; ratio_below < 12; ratio_below += 1.1) {
      const VectorXd x = Eigen::Vector2d(top - below, ratio_top - ratio_below);
      starts.push_back({x, f(x)});
    }
  }
  std::sort(starts.begin(), starts.end(),
            [](const Minimum& a, const Minimum& b) { return a.value < b.value; });
  Minimum best = starts[0];
  for (std::size_t i = 0; i < 2 && !std::isinf(starts[i].value); ++i) {
    const Minimum refined = minimise(f, starts[i].x, 0.3, 150);
    if (refined.value < best.value) best = refined;
  }
  return best;
}

}  // namespace

std::optional<Region> MatrixCondition::region(const Weights& weights) const {
  const Slack slack = slack_of(*this, weights);
  Extreme least{infinity, {}};
  Shape V;
  for (const ErrorSystem& system : systems) {
    const Extreme of_system = postures.smallest(
        [&](const Inertia& inertia) { return rho_at(*this, system, weights, inertia, slack); },
        refine);
    if (!(of_system.value > 0)) return {};
    if (of_system.value < least.value) least = of_system;
    const auto shape = shape_of(*this, system, weights, slack);
    if (!shape) return {};
    V.w = std::max(V.w, shape->w);
    V.alpha_2 = std::max(V.alpha_2, shape->alpha_2);
    V.inertia = shape->inertia;  // does not depend on the gains
    V.inverse_S = V.inverse_S.size() == 0 ? shape->inverse_S
                                          : VectorXd(V.inverse_S.cwiseMax(shape->inverse_S));
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
  return region;
}

Extreme MatrixCondition::slowest(const Weights& weights, double rho) const {
  const Slack slack = slack_of(*this, weights);
  Extreme least{infinity, {}};
  for (const ErrorSystem& system : systems) {
    const Extreme of_system = postures.smallest(
        [&](const Inertia& inertia) {
          return rate_at(*this, system, weights, rho, inertia, slack);
        },
        refine);
    if (of_system.value < least.value) least = of_system;
  }
  return least;
}

/// Searches on the coarse postures; where the fine ones certify much less at the weights found,
/// the postures that bind there join the coarse ones, and the search goes on from those weights.
std::optional<Certified> best_weights(MatrixCondition coarse, const MatrixCondition& fine,
                                      Goal goal) {
  constexpr int rounds = 6;
  const auto f = [&](const VectorXd& x) {  // to be minimised
    if (goal == Goal::rate) return -coarse.rate(weights_of(x), 0);
    const auto region = coarse.region(weights_of(x));
    return region ? -std::log(region->ball) : infinity;
  };
  const auto merit = [&](const Certified& c) {
    return goal == Goal::rate ? c.rate : std::log(c.region.ball);
  };
  Minimum best = search(coarse.systems[0], f);
  std::optional<Certified> result;
  for (int round = 0; round < rounds && !std::isinf(best.value); ++round) {
    const Weights weights = weights_of(best.x);
    const Extreme slowest = fine.slowest(weights, 0);
    const auto region = fine.region(weights);
    if (region) {
      Certified found{weights, *region, slowest.value};
      if (!result || merit(found) > merit(*result)) result = std::move(found);
    }
    if (coarse.postures.kind != Postures::Kind::sampled) break;
    coarse.postures.add(slowest.q);
    if (region) coarse.postures.add(region->q);
    if (f(best.x) - best.value <= 1e-2 * std::abs(best.value)) break;
    // The old optimum may have no value any more: nearby, with a smaller eps_2, there is one.
    VectorXd start = best.x;
    for (int i = 0; i < 12 && std::isinf(f(start)); ++i) start[0] -= 0.2;
    best = minimise(f, start, 0.3, 80);
  }
  return result;
}

}  // namespace tachless::certificate

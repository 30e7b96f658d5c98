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

/// Returns the symmetric square root of a symmetric matrix without negative eigenvalues.
MatrixXd square_root(const MatrixXd& A) {
  const auto [values, vectors] = numerics::symmetric_eigen(A);
  return vectors * values.cwiseMax(0).cwiseSqrt().asDiagonal() * vectors.transpose();
}

/// Returns the square root R of sum A_j^2, symmetric A_j: -R <= sum x_j A_j <= R for |x| <= 1. This
/// follows from the operator Cauchy-Schwarz inequality, because the square root is operator
/// monotone.
MatrixXd root_of_squares(const std::vector<MatrixXd>& A) {
  MatrixXd sum = MatrixXd::Zero(A[0].rows(), A[0].cols());
  for (const MatrixXd& a : A) sum.noalias() += a * a;
  return square_root(sum);
}

/// The same after a congruence by the diagonal matrix `scale`, undone afterwards.
MatrixXd root_of_squares_scaled(std::vector<MatrixXd> A, const VectorXd& scale) {
  const VectorXd inverse = scale.cwiseInverse();
  for (MatrixXd& a : A) a = (inverse.asDiagonal() * a * inverse.asDiagonal()).eval();
  return scale.asDiagonal() * root_of_squares(A) * scale.asDiagonal();
}

/// Returns L^-1 A L^-T. The lower triangle of `L` alone is read.
MatrixXd whitened(const MatrixXd& L, const MatrixXd& A) {
  const auto lower = L.triangularView<Eigen::Lower>();
  const MatrixXd left = lower.solve(A);
  return symmetric_part(lower.solve(left.transpose()));
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

/// Returns the matrices A_j with C(q, L x) = sum_j x_j A_j. An empty L stands for the identity.
std::vector<MatrixXd> combined(const std::vector<MatrixXd>& C, const MatrixXd& L) {
  return L.size() == 0 ? C : numerics::coriolis_along(C, L);
}

/// sym C(q, delta) in the same way, |L^-1 delta| = |x|.
std::vector<MatrixXd> coriolis_of_delta(const numerics::Inertia& inertia, const MatrixXd& L) {
  std::vector<MatrixXd> all = combined(inertia.C, L);
  for (MatrixXd& C : all) C = symmetric_part(C);
  return all;
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
  const MatrixXd at_rest =
      decrease_constant(system, weights) + decrease_of_inertia(system, weights, M);
  const VectorXd scale = at_rest.diagonal().cwiseAbs().cwiseMax(1e-300).cwiseSqrt();
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

/// Returns the numbers of the error coordinates (e, nu, edot) of the joints' errors number `from`
/// to `to` - 1.
std::vector<Index> coordinates(Index num_errors, Index from, Index to) {
  std::vector<Index> all;
  for (Index part = 0; part < 3; ++part) {
    for (Index i = from; i < to; ++i) all.push_back(part * num_errors + i);
  }
  return all;
}

/// Parts of the condition that are the same at all postures. Only the links' rows and columns of Mm
/// depend on the posture. The rotors' are eliminated once: with L L' the rotors' corner of Mm and C
/// the links' rows of the rotors' columns, Mm is positive definite where the links' corner less C
/// (L L')^-1 C' is.
struct Constant {
  Constant(const MatrixCondition& condition, const ErrorSystem& system, const Weights& weights)
      : slack(slack_of(condition, system, weights)),
        of_delta(delta_scale(system, weights)),
        decrease(decrease_constant(system, weights) - slack.decrease) {
    const Index N = system.num_errors(), n = system.num_links();
    links = coordinates(N, 0, n);
    rotors = coordinates(N, n, N);
    if (rotors.empty()) return;
    of_rotors.compute(decrease(rotors, rotors));
    positive = of_rotors.info() == Eigen::Success;
    if (positive) coupling = of_rotors.matrixL().solve(MatrixXd(decrease(rotors, links)));
  }

  /// Returns the Cholesky factor of the links' corner of a matrix with the rotors eliminated.
  /// Returns nothing if the matrix is not positive definite.
  [[nodiscard]] std::optional<Eigen::LLT<MatrixXd>> factor(const MatrixXd& Mm) const {
    if (!positive) return {};
    MatrixXd corner = Mm(links, links);
    if (!rotors.empty()) corner.noalias() -= coupling.transpose() * coupling;
    Eigen::LLT<MatrixXd> found(corner);
    if (found.info() != Eigen::Success) return {};
    return found;
  }
  /// Returns the states of all coordinates for columns of the links', with the rotors where they
  /// make the quadratic form least.
  [[nodiscard]] MatrixXd states(const MatrixXd& of_links) const {
    MatrixXd all(std::ssize(links) + std::ssize(rotors), of_links.cols());
    all(links, Eigen::all) = of_links;
    if (!rotors.empty()) {
      all(rotors, Eigen::all) = -of_rotors.matrixU().solve(coupling * of_links);
    }
    return all;
  }

  Slack slack;
  MatrixXd of_delta;  ///< as of `delta_scale`
  MatrixXd decrease;  ///< Mm without the links' inertia, v_ref and delta, less its slack
  std::vector<Index> links, rotors;
  Eigen::LLT<MatrixXd> of_rotors;
  MatrixXd coupling;     ///< L^-1 C'
  bool positive = true;  ///< whether the rotors' corner is positive definite
};

/// Returns the square root of sum A_j^2, A_j = L^-1 D_j L^-T, with D_j the links' rows and columns
/// of `decrease_of_coriolis` of C_j. D_j is U E' + E U', where E has the last n columns of the
/// identity. L is lower triangular, so that L^-1 E is 0 but for its last n rows. A_j is therefore 0
/// but for its last n rows and columns.
MatrixXd root_of_coriolis(const MatrixXd& L, const Weights& weights,
                          const std::vector<MatrixXd>& C) {
  const Index n = C[0].rows(), count = static_cast<Index>(C.size());
  MatrixXd U(3 * n, n * count);
  for (Index j = 0; j < count; ++j) {
    const MatrixXd& Cd = C[static_cast<std::size_t>(j)];
    const MatrixXd W = Cd.transpose() - Cd;
    U.middleCols(j * n, n) << -0.5 * (weights.eps_1.asDiagonal() * W),
        0.5 * (weights.eps_2.asDiagonal() * W), 0.5 * symmetric_part(Cd);
  }
  L.triangularView<Eigen::Lower>().solveInPlace(U);
  const auto last = L.bottomRightCorner(n, n).triangularView<Eigen::Lower>();
  // A_j has T in its last columns and T' in its last rows, and S in the corner.
  MatrixXd T(2 * n, n * count), S(n, n * count), corner = MatrixXd::Zero(n, n);
  for (Index j = 0; j < count; ++j) {
    const MatrixXd columns = last.solve(U.middleCols(j * n, n).transpose()).transpose();
    T.middleCols(j * n, n) = columns.topRows(2 * n);
    S.middleCols(j * n, n) = columns.bottomRows(n) + columns.bottomRows(n).transpose();
    corner.noalias() += T.middleCols(j * n, n).transpose() * T.middleCols(j * n, n);
  }
  MatrixXd sum(3 * n, 3 * n);
  sum.topLeftCorner(2 * n, 2 * n).noalias() = T * T.transpose();
  sum.topRightCorner(2 * n, n).noalias() = T * S.transpose();
  sum.bottomLeftCorner(n, 2 * n) = sum.topRightCorner(2 * n, n).transpose();
  sum.bottomRightCorner(n, n) = corner + S * S.transpose();
  return square_root(sum);
}

/// Returns a matrix that is positive definite only if Mm at delta = 0 is, for every v_ref of the
/// condition. Returns nothing when the congruence fails; Mm is then not positive definite.
std::optional<MatrixXd> decrease_at(const MatrixCondition& condition, const ErrorSystem& system,
                                    const Weights& weights, const numerics::Inertia& inertia,
                                    const Constant& constant) {
  MatrixXd at_rest = constant.decrease + decrease_of_inertia(system, weights, inertia.M);
  if (condition.B_d == 0) return at_rest;
  if (system.v_ref.size() > 0) {  // known
    const MatrixXd Cd = combined(inertia.C, system.v_ref)[0];
    return at_rest + decrease_of_coriolis(system, weights, Cd);
  }
  const auto factor = constant.factor(at_rest);
  if (!factor) return {};
  const MatrixXd L = factor->matrixL();
  const MatrixXd root =
      root_of_coriolis(L, weights.of(system.num_links()), combined(inertia.C, condition.v_scale));
  at_rest(constant.links, constant.links) -= condition.B_d * (L * root * L.transpose());
  return at_rest;
}

/// How many states that bind are given: the eigenvalues near the least one.
constexpr Index few = 3;

/// Returns rho at a posture.
/// @param states receives the states that bind rho, if it is given
double rho_at(const MatrixCondition& condition, const ErrorSystem& system, const Weights& weights,
              const numerics::Inertia& inertia, const Constant& constant,
              MatrixXd* states = nullptr) {
  const Index n = system.num_links();
  const auto F = decrease_at(condition, system, weights, inertia, constant);
  const auto factor = F ? constant.factor(*F) : std::nullopt;
  if (!factor) return 0;
  // F - rho E D E' > 0 exactly when rho lambda_max(H' D H) < 1, H H' = E' F^-1 E.
  const MatrixXd E = MatrixXd::Identity(3 * n, 3 * n).rightCols(n);
  const Eigen::LLT<MatrixXd> root(factor->solve(E).bottomRows(n));
  const MatrixXd H = root.matrixL();
  MatrixXd sum = MatrixXd::Zero(n, n);
  for (const MatrixXd& C : coriolis_of_delta(inertia, constant.of_delta)) {
    const MatrixXd scaled = H.transpose() * C * H;
    sum.noalias() += scaled * scaled;
  }
  if (states != nullptr) {
    const MatrixXd u = numerics::symmetric_eigen(sum).vectors.rightCols(std::min(few, n));
    *states = constant.states(factor->solve(E * root.matrixU().solve(u)));
  }
  const double largest = std::sqrt(std::max(0.0, numerics::largest_eigenvalue(sum))) +
                         numerics::largest_eigenvalue(H.transpose() * constant.slack.delta * H);
  return strictly_below / std::max(largest, 1e-300);
}

bool is_positive(const MatrixXd& A) { return A.llt().info() == Eigen::Success; }

/// Returns the rate at a posture, or infinity where it is above `enough`.
/// @param states receives the states that bind it, if it is given
double rate_at(const MatrixCondition& condition, const ErrorSystem& system, const Weights& weights,
               double rho, const numerics::Inertia& inertia, const Constant& constant,
               double enough, MatrixXd* states = nullptr) {
  const Index N = system.num_errors(), n = system.num_links();
  // P of the posture, enlarged by its change up to the next posture.
  MatrixXd P = lyapunov_matrix(system, weights, inertia.M);
  Eigen::LLT<MatrixXd> half_P(P / 2);
  if (half_P.info() != Eigen::Success) return -infinity;
  if (const double slack = constant.slack.of_lyapunov(weights); slack > 0) {
    P.diagonal().array() += slack;
    half_P.compute(P / 2);
  }
  auto F = decrease_at(condition, system, weights, inertia, constant);
  const bool certified = F.has_value();
  // Not certified: how far from it, to guide a search.
  if (!certified) F = constant.decrease + decrease_of_inertia(system, weights, inertia.M);
  if (certified && rho != 0) {
    // After the congruence by which rho is found: positive inside of it.
    const auto factor = constant.factor(*F);
    if (!factor) return -infinity;
    const MatrixXd E = MatrixXd::Identity(3 * n, 3 * n).rightCols(n);
    const Eigen::LLT<MatrixXd> root(factor->solve(E).bottomRows(n));
    std::vector<MatrixXd> of_delta;
    for (const MatrixXd& C : coriolis_of_delta(inertia, constant.of_delta)) {
      of_delta.push_back(root.matrixU() * C * root.matrixL());
    }
    const MatrixXd half = root.matrixU().solve(root_of_squares(of_delta));
    F->block(2 * N, 2 * N, n, n) -=
        rho * (root.matrixU().solve(half.transpose()) + constant.slack.delta);
  }
  if (certified && std::isfinite(enough) && is_positive(*F - enough / 2 * P)) return infinity;
  const MatrixXd scaled = whitened(half_P.matrixLLT(), *F);
  if (states != nullptr) {
    *states = half_P.matrixU().solve(numerics::symmetric_eigen(scaled).vectors.leftCols(few));
  }
  const double least = numerics::smallest_eigenvalue(scaled);
  return certified ? least : std::min(0.0, least);
}

/// Extremes of V over the postures.
struct Shape {
  double alpha_2 = 0;  ///< V <= alpha_2 |x|^2
  VectorXd inertia;    ///< largest M_ii
  VectorXd inverse_S;  ///< largest (S^-1)_ii of the position errors
  VectorXd feedback;   ///< largest g' S^-1 g of Kp e + Kd nu = g' (e, nu), of each joint
};

/// Returns the Cholesky factor of S at a posture. S is antitone and its inverse convex in M, so
/// that the extremes over a chord, enlarged by the slack, are at its ends.
Eigen::LLT<MatrixXd> factor_of_S(const ErrorSystem& system, const Weights& weights,
                                 const MatrixXd& links_M) {
  const MatrixXd G = delta_of(system, weights).transpose();
  return Eigen::LLT<MatrixXd>(stiffness_of(system) - G * system.inertia(links_M) * G.transpose());
}

/// Returns the largest w over the postures; infinity where V is not positive definite.
double largest_w(const MatrixCondition& condition, const ErrorSystem& system,
                 const Weights& weights, const Constant& constant) {
  const MatrixXd G = delta_of(system, weights).topRows(system.num_links());
  const MatrixXd in_L = constant.of_delta.triangularView<Eigen::Lower>().solve(G);
  const auto negative = [&](const numerics::Inertia& inertia, double enough) {
    const auto S = factor_of_S(system, weights, inertia.M + constant.slack.M);
    if (S.info() != Eigen::Success) return -infinity;
    const MatrixXd half = S.matrixL().solve(in_L.transpose());
    if (-half.squaredNorm() > enough) return infinity;
    return -numerics::largest_eigenvalue(half.transpose() * half);
  };
  return -condition.postures.smallest(negative, condition.refine).value;
}

std::optional<Shape> shape_of(const MatrixCondition& condition, const ErrorSystem& system,
                              const Weights& weights, const Slack& slack) {
  const Index N = system.num_errors();
  Shape result;
  const auto negative = [&](const numerics::Inertia& inertia, double enough) {
    const MatrixXd P = lyapunov_matrix(system, weights, inertia.M);
    const MatrixXd above = -2 * enough * MatrixXd::Identity(P.rows(), P.cols()) - P;
    if (std::isfinite(enough) && is_positive(above)) return infinity;
    return -numerics::largest_eigenvalue(P) / 2;
  };
  result.alpha_2 = -condition.postures.smallest(negative, condition.refine).value;
  result.alpha_2 += slack.of_lyapunov(weights) / 2;
  result.inertia = VectorXd::Zero(N);
  result.inverse_S = VectorXd::Zero(N);
  result.feedback = VectorXd::Zero(N);
  MatrixXd rows = MatrixXd::Zero(2 * N, 2 * N);  // columns: the position errors, and each g
  rows.topLeftCorner(N, N).setIdentity();
  rows.topRightCorner(N, N) = system.kp;
  rows.bottomRightCorner(N, N) = system.kd;
  for (const numerics::Inertia& inertia : condition.postures.inertia) {
    const auto S = factor_of_S(system, weights, inertia.M + slack.M);
    if (S.info() != Eigen::Success) return {};
    const VectorXd size = S.matrixL().solve(rows).colwise().squaredNorm();
    result.inertia = result.inertia.cwiseMax(system.inertia(inertia.M + slack.M).diagonal());
    result.inverse_S = result.inverse_S.cwiseMax(size.head(N));
    result.feedback = result.feedback.cwiseMax(size.tail(N));
  }
  return result;
}

/// rho and w over all postures and systems.
struct Level {
  numerics::Extreme rho{infinity, {}};
  double w = 0;

  [[nodiscard]] double value() const { return w > 0 ? rho.value * rho.value / (2 * w) : infinity; }
};

/// Returns the constant parts of the condition for each of its systems.
std::vector<Constant> constants_of(const MatrixCondition& condition, const Weights& weights) {
  std::vector<Constant> result;
  for (const ErrorSystem& system : condition.systems) {
    result.emplace_back(condition, system, weights);
  }
  return result;
}

/// @param constants as of `constants_of`
std::optional<Level> level_of(const MatrixCondition& condition, const Weights& weights,
                              const std::vector<Constant>& constants) {
  Level result;
  for (std::size_t i = 0; i < constants.size(); ++i) {
    const ErrorSystem& system = condition.systems[i];
    const Constant& constant = constants[i];
    const numerics::Extreme rho = condition.postures.smallest(
        [&](const numerics::Inertia& inertia, double /*enough*/) {
          return rho_at(condition, system, weights, inertia, constant);
        },
        condition.refine);
    if (!(rho.value > 0)) return {};
    if (rho.value < result.rho.value) result.rho = rho;
    result.w = std::max(result.w, largest_w(condition, system, weights, constant));
    if (std::isinf(result.w)) return {};
  }
  return result;
}

}  // namespace

MatrixXd delta_scale(const ErrorSystem& system, const Weights& weights) {
  const MatrixXd N = delta_of(system, weights).topRows(system.num_links());
  return (N * stiffness_of(system).llt().solve(N.transpose())).llt().matrixL();
}

double MatrixCondition::level(const Weights& weights) const {
  const auto found = level_of(*this, weights, constants_of(*this, weights));
  return found ? found->value() : -infinity;
}

std::optional<Region> MatrixCondition::region(const Weights& weights) const {
  const std::vector<Constant> constants = constants_of(*this, weights);
  const auto level = level_of(*this, weights, constants);
  if (!level) return {};
  Shape V;
  for (std::size_t i = 0; i < systems.size(); ++i) {
    auto shape = shape_of(*this, systems[i], weights, constants[i].slack);
    if (!shape) return {};
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
  region.rho = level->rho.value;
  region.q = level->rho.q;
  region.w = level->w;
  region.level = level->value();
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
  const Constant constant(*this, system, weights);
  return goal == Goal::rate
             ? rate_at(*this, system, weights, 0, inertia, constant, infinity, &states)
             : rho_at(*this, system, weights, inertia, constant, &states);
}

numerics::Extreme MatrixCondition::slowest(const Weights& weights, double rho) const {
  numerics::Extreme least{infinity, {}};
  for (const ErrorSystem& system : systems) {
    const Constant constant(*this, system, weights);
    const numerics::Extreme of_system = postures.smallest(
        [&](const numerics::Inertia& inertia, double enough) {
          return rate_at(*this, system, weights, rho, inertia, constant, enough);
        },
        refine);
    if (of_system.value < least.value) least = of_system;
  }
  return least;
}

}  // namespace tachless::lyapunov

#include "lyapunov/matrix_condition.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <utility>

#include "lyapunov/examined_weights.h"
#include "numerics/decompositions.h"

namespace tachless::lyapunov {

/// Bounds on the parts of matrices that may be missing between two postures.
struct Slack {
  Eigen::MatrixXd M;         ///< of the links' M
  Eigen::MatrixXd decrease;  ///< of Mm without delta
  Eigen::MatrixXd delta;     ///< of sym C(q, delta), |delta|_L = 1
  double V = 0;              ///< of V's matrix
};

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
  const auto size = weights.eps_1.array().square() + weights.eps_2.array().square();
  result.V = numerics::spectral_norm(result.M) * (1 + std::sqrt(size.maxCoeff()));
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

}  // namespace

/// S = diag(Kp, Kd B^-1) - N' M N with delta = N (e, nu), as a function of the links' M.
class PositionPart {
 public:
  PositionPart(const ErrorSystem& system, const Weights& weights)
      : links_(system.num_links()), at_no_inertia_(stiffness_of(system)) {
    const Index N = system.num_errors();
    const Weights each = weights.of(N);
    by_ = {each.eps_1, -each.eps_2};
    for (Index i = links_; i < N; ++i) {
      const double J = system.rotor_inertia[i - links_];
      for (Index a = 0; a < 2; ++a) {
        for (Index b = 0; b < 2; ++b)
          at_no_inertia_(a * N + i, b * N + i) -= by(a)[i] * J * by(b)[i];
      }
    }
  }

  /// Returns the Cholesky factor of S. S is antitone and its inverse convex in M, so that the
  /// extremes over a chord, enlarged by the slack, are at its ends.
  [[nodiscard]] Eigen::LLT<MatrixXd> factor(const MatrixXd& links_M) const {
    MatrixXd S = at_no_inertia_;
    const Index N = S.rows() / 2;
    for (Index a = 0; a < 2; ++a) {
      for (Index b = 0; b < 2; ++b) {
        S.block(a * N, b * N, links_, links_) -=
            by(a).head(links_).asDiagonal() * links_M * by(b).head(links_).asDiagonal();
      }
    }
    return Eigen::LLT<MatrixXd>(S);
  }

 private:
  /// E1 or -E2, the blocks of N.
  [[nodiscard]] const VectorXd& by(Index block) const {
    return by_[static_cast<std::size_t>(block)];
  }

  Index links_;
  MatrixXd at_no_inertia_;  ///< S where the links' M is 0
  std::array<VectorXd, 2> by_;
};

/// The rotors eliminated from symmetric matrices of which only the links' corner depends on the
/// posture. With L L' the rotors' corner and C the links' rows of the rotors' columns, the matrix
/// is positive definite where the links' corner less C (L L')^-1 C' is.
class WithoutRotors {
 public:
  /// @param A the matrix; its links' corner is not read
  WithoutRotors(const MatrixXd& A, const std::vector<Index>& links,
                const std::vector<Index>& rotors)
      : links_(links), rotors_(rotors) {
    if (rotors.empty()) return;
    of_rotors_.compute(A(rotors, rotors));
    positive_ = of_rotors_.info() == Eigen::Success;
    if (!positive_) return;
    coupling_ = of_rotors_.matrixL().solve(MatrixXd(A(rotors, links)));
    by_rotors_ = coupling_.transpose() * coupling_;
  }

  /// Returns the Cholesky factor of the links' corner of the matrix with the rotors eliminated.
  /// Returns nothing if the matrix is not positive definite.
  [[nodiscard]] std::optional<Eigen::LLT<MatrixXd>> factor(const MatrixXd& corner) const {
    if (!positive_) return {};
    Eigen::LLT<MatrixXd> found(rotors_.empty() ? corner : corner - by_rotors_);
    if (found.info() != Eigen::Success) return {};
    return found;
  }
  /// Returns the states of all coordinates for columns of the links', with the rotors where they
  /// make the quadratic form least.
  [[nodiscard]] MatrixXd states(const MatrixXd& in_links) const {
    MatrixXd all(std::ssize(links_) + std::ssize(rotors_), in_links.cols());
    all(links_, Eigen::all) = in_links;
    if (!rotors_.empty()) {
      all(rotors_, Eigen::all) = -of_rotors_.matrixU().solve(coupling_ * in_links);
    }
    return all;
  }

 private:
  std::vector<Index> links_, rotors_;
  Eigen::LLT<MatrixXd> of_rotors_;
  MatrixXd coupling_;     ///< L^-1 C'
  MatrixXd by_rotors_;    ///< C (L L')^-1 C'
  bool positive_ = true;  ///< whether the rotors' corner is positive definite
};

/// Mm, and the matrix of 2 V, with what does not depend on the posture.
struct ConstantParts {
  ConstantParts(const MatrixCondition& condition, const ErrorSystem& system, const Weights& weights)
      : slack(slack_of(condition, system, weights)),
        of_delta(delta_scale(system, weights)),
        of_links{{}, {}, system.a.head(system.num_links()), system.b.head(system.num_links()), {}},
        links_weights(weights.of(system.num_errors()).of(system.num_links())),
        links(coordinates(system.num_errors(), 0, system.num_links())),
        rotors(coordinates(system.num_errors(), system.num_links(), system.num_errors())),
        decrease(decrease_constant(system, weights) - slack.decrease),
        V(lyapunov_matrix(system, weights, MatrixXd::Zero(system.num_links(), system.num_links()))),
        decrease_corner(decrease(links, links)),
        V_corner(V(links, links)),
        of_decrease(decrease, links, rotors),
        of_V(V, links, rotors),
        of_positions(system, weights),
        known(condition.postures.inertia.size()) {}

  /// Returns the matrix with this corner of the links.
  [[nodiscard]] MatrixXd whole(const MatrixXd& constant, const MatrixXd& of_links_alone) const {
    MatrixXd all = constant;
    all(links, links) = of_links_alone;
    return all;
  }
  /// Returns the links' corner of the matrix of 2 V.
  [[nodiscard]] MatrixXd V_corner_at(const MatrixXd& M) const {
    return V_corner + lyapunov_of_inertia(links_weights, M);
  }

  /// The corner of Mm at a posture of the set, once it was asked for.
  struct Known {
    bool asked = false;
    std::optional<MatrixXd> corner;
  };

  Slack slack;
  MatrixXd of_delta;     ///< as of `delta_scale`
  ErrorSystem of_links;  ///< the links' filters, without what does not belong to M and C
  Weights links_weights;
  std::vector<Index> links, rotors;
  MatrixXd decrease;                   ///< Mm without the links' M, v_ref, delta and its slack
  MatrixXd V;                          ///< the matrix of 2 V without the links' M
  MatrixXd decrease_corner, V_corner;  ///< of the links
  WithoutRotors of_decrease, of_V;
  PositionPart of_positions;
  /// One for each posture. Only one thread at a time looks at a posture.
  mutable std::vector<Known> known;
};

namespace {

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

/// Returns the links' corner of Mm at rest.
MatrixXd corner_at_rest(const numerics::Inertia& inertia, const ConstantParts& constant) {
  return constant.decrease_corner +
         decrease_of_inertia(constant.of_links, constant.links_weights, inertia.M);
}

/// Returns the links' corner of a matrix that is positive definite only if Mm at delta = 0 is, for
/// every v_ref of the condition. Returns nothing when the congruence fails; Mm is then not positive
/// definite.
std::optional<MatrixXd> new_corner_at(const MatrixCondition& condition, const ErrorSystem& system,
                                      const numerics::Inertia& inertia,
                                      const ConstantParts& constant) {
  MatrixXd at_rest = corner_at_rest(inertia, constant);
  if (condition.B_d == 0) return at_rest;
  if (system.v_ref.size() > 0) {  // known
    const MatrixXd Cd = combined(inertia.C, system.v_ref)[0];
    return at_rest + decrease_of_coriolis(constant.of_links, constant.links_weights, Cd);
  }
  const auto factor = constant.of_decrease.factor(at_rest);
  if (!factor) return {};
  const MatrixXd L = factor->matrixL();
  const MatrixXd root =
      root_of_coriolis(L, constant.links_weights, combined(inertia.C, condition.v_scale));
  at_rest -= condition.B_d * (L * root * L.transpose());
  return at_rest;
}

/// Returns the same. At a posture of the condition's set it is computed once.
std::optional<MatrixXd> corner_at(const MatrixCondition& condition, const ErrorSystem& system,
                                  const numerics::Inertia& inertia, const ConstantParts& constant) {
  const numerics::Inertia* const first = condition.postures.inertia.data();
  const std::less<> before;
  if (before(&inertia, first) || !before(&inertia, first + constant.known.size())) {
    return new_corner_at(condition, system, inertia, constant);
  }
  ConstantParts::Known& known = constant.known[static_cast<std::size_t>(&inertia - first)];
  if (!known.asked) known = {true, new_corner_at(condition, system, inertia, constant)};
  return known.corner;
}

/// How many states that bind are given: the eigenvalues near the least one.
constexpr Index few = 3;

/// Returns rho at a posture.
/// @param binding receives the states that bind rho, if it is given
double rho_at(const MatrixCondition& condition, const ErrorSystem& system,
              const numerics::Inertia& inertia, const ConstantParts& constant,
              BindingStates* binding = nullptr) {
  const Index n = system.num_links();
  const auto F = corner_at(condition, system, inertia, constant);
  const auto factor = F ? constant.of_decrease.factor(*F) : std::nullopt;
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
  const double of_slack = numerics::largest_eigenvalue(H.transpose() * constant.slack.delta * H);
  const auto rho_of = [&](double square) {
    return strictly_below / std::max(std::sqrt(std::max(0.0, square)) + of_slack, 1e-300);
  };
  if (binding == nullptr) return rho_of(numerics::largest_eigenvalue(sum));
  const auto [squares, vectors] = numerics::symmetric_eigen(sum);
  const Index count = std::min(few, n);
  const MatrixXd in_links = factor->solve(E * root.matrixU().solve(vectors.rightCols(count)));
  *binding = {squares.tail(count).unaryExpr(rho_of), constant.of_decrease.states(in_links)};
  return binding->value.minCoeff();
}

/// Tells where the rate is above a number: Mm - number/2 of V's matrix is positive definite.
class RateAbove {
 public:
  RateAbove(const ConstantParts& constant, double number)
      : number_(number),
        slack_(constant.slack.V),
        difference_(of(constant.decrease, constant.V), constant.links, constant.rotors) {}

  [[nodiscard]] bool operator()(const MatrixXd& decrease_corner, const MatrixXd& V_corner) const {
    return difference_.factor(of(decrease_corner, V_corner)).has_value();
  }

 private:
  [[nodiscard]] MatrixXd of(const MatrixXd& decrease, const MatrixXd& V) const {
    MatrixXd difference = decrease - number_ / 2 * V;
    difference.diagonal().array() -= number_ / 2 * slack_;
    return difference;
  }

  double number_, slack_;
  WithoutRotors difference_;
};

/// Takes from Mm's corner at v_ref what delta up to rho may take, after the congruence by which rho
/// is found. Returns false where Mm is not positive definite inside of rho.
bool take_delta(const numerics::Inertia& inertia, const ConstantParts& constant, double rho,
                MatrixXd& corner) {
  const Index n = inertia.M.rows();
  const auto factor = constant.of_decrease.factor(corner);
  if (!factor) return false;
  const MatrixXd E = MatrixXd::Identity(3 * n, 3 * n).rightCols(n);
  const Eigen::LLT<MatrixXd> root(factor->solve(E).bottomRows(n));
  std::vector<MatrixXd> of_delta;
  for (const MatrixXd& C : coriolis_of_delta(inertia, constant.of_delta)) {
    of_delta.push_back(root.matrixU() * C * root.matrixL());
  }
  const MatrixXd half = root.matrixU().solve(root_of_squares(of_delta));
  corner.bottomRightCorner(n, n) -=
      rho * (root.matrixU().solve(half.transpose()) + constant.slack.delta);
  return true;
}

/// Returns the rate at a posture, or infinity where it is above `enough`.
/// @param binding receives the states that bind it, if it is given
double rate_at(const MatrixCondition& condition, const ErrorSystem& system, double rho,
               const numerics::Inertia& inertia, const ConstantParts& constant,
               const std::optional<RateAbove>& enough, BindingStates* binding = nullptr) {
  const MatrixXd V_corner = constant.V_corner_at(inertia.M);
  if (!constant.of_V.factor(V_corner)) return -infinity;
  auto corner = corner_at(condition, system, inertia, constant);
  const bool certified = corner.has_value();
  // Not certified: how far from it, to guide a search.
  if (!certified) corner = corner_at_rest(inertia, constant);
  if (certified && rho != 0 && !take_delta(inertia, constant, rho, *corner)) return -infinity;
  if (certified && enough && (*enough)(*corner, V_corner)) return infinity;
  // P of the posture, enlarged by its change up to the next posture.
  MatrixXd P = constant.whole(constant.V, V_corner);
  P.diagonal().array() += constant.slack.V;
  const Eigen::LLT<MatrixXd> half_P(P / 2);
  if (half_P.info() != Eigen::Success) return -infinity;
  const MatrixXd scaled = whitened(half_P.matrixLLT(), constant.whole(constant.decrease, *corner));
  const auto rate_of = [&](double least) { return certified ? least : std::min(0.0, least); };
  if (binding == nullptr) return rate_of(numerics::smallest_eigenvalue(scaled));
  const auto [rates, vectors] = numerics::symmetric_eigen(scaled);
  *binding = {rates.head(few).unaryExpr(rate_of), half_P.matrixU().solve(vectors.leftCols(few))};
  return binding->value.minCoeff();
}

/// Extremes of V over the postures.
struct Shape {
  VectorXd inertia;    ///< largest M_ii
  VectorXd inverse_S;  ///< largest (S^-1)_ii of the position errors
  VectorXd feedback;   ///< largest g' S^-1 g of Kp e + Kd nu = g' (e, nu), of each joint
};

/// Returns the largest w over the postures, negative; minus infinity where V is not positive
/// definite.
numerics::Extreme negative_w(const MatrixCondition& condition, const ErrorSystem& system,
                             const Weights& weights, const ConstantParts& constant) {
  const MatrixXd G = delta_of(system, weights).topRows(system.num_links());
  const MatrixXd in_L = constant.of_delta.triangularView<Eigen::Lower>().solve(G);
  const auto negative = [&](double enough) {
    return [&, enough](const numerics::Inertia& inertia) {
      const auto S = constant.of_positions.factor(inertia.M + constant.slack.M);
      if (S.info() != Eigen::Success) return -infinity;
      const MatrixXd half = S.matrixL().solve(in_L.transpose());
      if (-half.squaredNorm() > enough) return infinity;
      return -numerics::largest_eigenvalue(half.transpose() * half);
    };
  };
  return condition.postures.smallest(negative, {condition.refine, numerics::Postures::Reads::M});
}

/// Returns the least alpha_2 of a system with V <= alpha_2 |x|^2 at all postures.
double largest_V(const MatrixCondition& condition, const ErrorSystem& system,
                 const Weights& weights, const Slack& slack) {
  const auto negative = [&](double enough) {
    return [&, enough](const numerics::Inertia& inertia) {
      const MatrixXd P = lyapunov_matrix(system, weights, inertia.M);
      const MatrixXd above = -2 * enough * MatrixXd::Identity(P.rows(), P.cols()) - P;
      if (std::isfinite(enough) && above.llt().info() == Eigen::Success) return infinity;
      return -numerics::largest_eigenvalue(P) / 2;
    };
  };
  const auto least =
      condition.postures.smallest(negative, {condition.refine, numerics::Postures::Reads::M});
  return -least.value + slack.V / 2;
}

std::optional<Shape> shape_of(const MatrixCondition& condition, const ErrorSystem& system,
                              const ConstantParts& constant) {
  const Index N = system.num_errors();
  Shape result{VectorXd::Zero(N), VectorXd::Zero(N), VectorXd::Zero(N)};
  MatrixXd rows = MatrixXd::Zero(2 * N, 2 * N);  // columns: the position errors, and each g
  rows.topLeftCorner(N, N).setIdentity();
  rows.topRightCorner(N, N) = system.kp;
  rows.bottomRightCorner(N, N) = system.kd;
  for (const numerics::Inertia& inertia : condition.postures.inertia) {
    const auto S = constant.of_positions.factor(inertia.M + constant.slack.M);
    if (S.info() != Eigen::Success) return {};
    const VectorXd size = S.matrixL().solve(rows).colwise().squaredNorm();
    result.inertia =
        result.inertia.cwiseMax(system.inertia(inertia.M + constant.slack.M).diagonal());
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

/// @param constants one of each system
/// @param above a level [J]: returns nothing where the result is seen not to be larger
/// @param forbids receives the posture at which it is not larger, if it was a refined one
std::optional<Level> level_of(const MatrixCondition& condition, const Weights& weights,
                              const std::vector<ConstantParts>& constants, double above,
                              Vector* forbids = nullptr) {
  // A rounding error must not hide a level that is larger.
  const double not_above = (1 - 1e-9) * std::max(above, 0.0);
  Level result;
  for (std::size_t i = 0; i < constants.size(); ++i) {
    const ErrorSystem& system = condition.systems[i];
    const ConstantParts& constant = constants[i];
    const numerics::Extreme w = negative_w(condition, system, weights, constant);
    result.w = std::max(result.w, -w.value);
    if (std::isinf(result.w)) {
      if (forbids != nullptr) *forbids = w.q;
      return {};
    }
    const double too_small = std::sqrt(2 * result.w * not_above);
    const numerics::Extreme rho = condition.postures.smallest(
        [&](double /*enough*/) {
          return [&](const numerics::Inertia& inertia) {
            return rho_at(condition, system, inertia, constant);
          };
        },
        {.refine = condition.refine, .above = too_small});
    if (!(rho.value > too_small)) {
      if (forbids != nullptr) *forbids = rho.q;
      return {};
    }
    if (rho.value < result.rho.value) result.rho = rho;
  }
  return result;
}

}  // namespace

MatrixXd delta_scale(const ErrorSystem& system, const Weights& weights) {
  const MatrixXd N = delta_of(system, weights).topRows(system.num_links());
  return (N * stiffness_of(system).llt().solve(N.transpose())).llt().matrixL();
}

ExaminedWeights::ExaminedWeights(const MatrixCondition& condition, const Weights& weights)
    : condition_(condition), weights_(weights) {
  for (const ErrorSystem& system : condition.systems) {
    constants_.emplace_back(condition, system, weights);
  }
}

ExaminedWeights::~ExaminedWeights() = default;

double ExaminedWeights::level(double above) const {
  const auto found = level_of(condition_, weights_, constants_, above);
  return found ? found->value() : -infinity;
}

std::optional<Region> ExaminedWeights::region_without_ball(Vector* forbids) const {
  const auto level = level_of(condition_, weights_, constants_, -infinity, forbids);
  if (!level) {
    // The search for rho ends at any posture of the set that forbids the weights. The slowest one
    // forbids them most.
    if (forbids != nullptr && forbids->size() == 0) *forbids = slowest(0).q;
    return {};
  }
  Shape V;
  for (std::size_t i = 0; i < constants_.size(); ++i) {
    auto shape = shape_of(condition_, condition_.systems[i], constants_[i]);
    if (!shape) return {};
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
  const double diameter = std::sqrt(2 * region.level);
  region.e_at_rest = diameter * condition_.systems[0].kp.diagonal().cwiseInverse().cwiseSqrt();
  region.edot = diameter * V.inertia.cwiseInverse().cwiseSqrt();
  region.e_reached = diameter * V.inverse_S.cwiseSqrt();
  region.feedback = V.feedback.cwiseSqrt();
  return region;
}

std::optional<Region> ExaminedWeights::region() const {
  auto found = region_without_ball();
  if (found) found->ball = ball(found->level);
  return found;
}

double ExaminedWeights::ball(double level) const {
  double alpha_2 = 0;
  for (std::size_t i = 0; i < constants_.size(); ++i) {
    alpha_2 = std::max(alpha_2,
                       largest_V(condition_, condition_.systems[i], weights_, constants_[i].slack));
  }
  return std::sqrt(level / alpha_2);
}

numerics::Extreme ExaminedWeights::slowest(double rho, double above) const {
  numerics::Extreme least{infinity, {}};
  for (std::size_t i = 0; i < constants_.size() && least.value > above; ++i) {
    const numerics::Extreme of_system = condition_.postures.smallest(
        [&](double enough) {
          std::optional<RateAbove> above_enough;
          if (std::isfinite(enough)) above_enough.emplace(constants_[i], enough);
          return [&, above_enough](const numerics::Inertia& inertia) {
            return rate_at(condition_, condition_.systems[i], rho, inertia, constants_[i],
                           above_enough);
          };
        },
        {.refine = condition_.refine, .above = above});
    if (of_system.value < least.value) least = of_system;
  }
  return least;
}

BindingStates ExaminedWeights::binding(Goal goal, std::size_t system, std::size_t posture) const {
  const ErrorSystem& of = condition_.systems[system];
  const numerics::Inertia& inertia = condition_.postures.inertia[posture];
  const ConstantParts& constant = constants_[system];
  BindingStates found;
  if (goal == Goal::rate) {
    rate_at(condition_, of, 0, inertia, constant, {}, &found);
  } else {
    rho_at(condition_, of, inertia, constant, &found);
  }
  return found;
}

std::optional<MatrixXd> ExaminedWeights::decrease(std::size_t system, std::size_t posture) const {
  const ConstantParts& constant = constants_[system];
  const auto corner = corner_at(condition_, condition_.systems[system],
                                condition_.postures.inertia[posture], constant);
  if (!corner) return {};
  return constant.whole(constant.decrease, *corner);
}

Eigen::LLT<MatrixXd> ExaminedWeights::position_part(std::size_t system, std::size_t posture) const {
  return constants_[system].of_positions.factor(condition_.postures.inertia[posture].M);
}

double ExaminedWeights::slack_of_V(std::size_t system) const { return constants_[system].slack.V; }

double MatrixCondition::level(const Weights& weights) const {
  return ExaminedWeights(*this, weights).level();
}

std::optional<Region> MatrixCondition::region(const Weights& weights) const {
  return ExaminedWeights(*this, weights).region();
}

numerics::Extreme MatrixCondition::slowest(const Weights& weights, double rho) const {
  return ExaminedWeights(*this, weights).slowest(rho);
}

}  // namespace tachless::lyapunov

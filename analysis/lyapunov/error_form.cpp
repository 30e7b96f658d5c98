#include "lyapunov/error_form.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "base/parallel.h"
#include "lyapunov/error_system.h"
#include "numerics/decompositions.h"
#include "numerics/matrix_inequalities.h"

namespace tachless::lyapunov {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using numerics::MatrixInequality;

/// Corners of a polygon around the unit circle, for two joints.
std::vector<VectorXd> corners_around_the_circle(int count) {
  std::vector<VectorXd> all;
  const double step = 2 * std::numbers::pi / count;
  for (int k = 0; k < count; ++k) {
    all.emplace_back(Eigen::Vector2d(std::cos(k * step), std::sin(k * step)) / std::cos(step / 2));
  }
  return all;
}

MatrixXd coriolis_along(const std::vector<MatrixXd>& C, const VectorXd& x) {
  MatrixXd sum = MatrixXd::Zero(x.size(), x.size());
  for (Index j = 0; j < x.size(); ++j) sum += x[j] * C[static_cast<std::size_t>(j)];
  return symmetric_part(sum);
}

/// Returns matrices whose every convex combination bounds sym C(q, x), |x| <= 1, from above. For
/// more than two joints it is the root of the sum of squares, by the operator Cauchy-Schwarz
/// inequality, in coordinates in which M is 1.
std::vector<MatrixXd> coriolis_bounds(const ErrorForm& form, int corners) {
  const Index n = form.M.rows();
  std::vector<MatrixXd> all;
  if (n == 2) {
    for (const VectorXd& x : corners_around_the_circle(corners)) {
      all.push_back(coriolis_along(form.C, x));
    }
    return all;
  }
  const Eigen::LLT<MatrixXd> llt(form.M);
  MatrixXd sum = MatrixXd::Zero(n, n);
  for (Index j = 0; j < n; ++j) {
    const MatrixXd left = llt.matrixL().solve(coriolis_along(form.C, VectorXd::Unit(n, j)));
    const MatrixXd white = llt.matrixL().solve(left.transpose());
    sum += white * white;
  }
  const auto [values, vectors] = numerics::symmetric_eigen(sum);
  const MatrixXd L = llt.matrixL();
  all.push_back(L * vectors * values.cwiseMax(0).cwiseSqrt().asDiagonal() * vectors.transpose() *
                L.transpose());
  return all;
}

/// @param L of the norm of delta
FormResult at(const ErrorForm& form, const FormWeights& weights, const MatrixXd& L) {
  constexpr int corners = 48;
  const Index m = form.Fy.rows(), n = form.M.rows();
  const Eigen::LLT<MatrixXd> V(lyapunov_matrix(form, weights)), Mm(decrease_matrix(form, weights));
  if (V.info() != Eigen::Success || Mm.info() != Eigen::Success) return {};
  FormResult result;
  const MatrixXd half = V.matrixL().solve(MatrixXd(Mm.matrixL()));
  result.rate = 2 * numerics::smallest_eigenvalue(half * half.transpose());
  const MatrixXd S = weights.P - weights.N.transpose() * form.M * weights.N;
  const MatrixXd N = L.triangularView<Eigen::Lower>().solve(weights.N);
  const Eigen::LLT<MatrixXd> of_S(S);
  if (of_S.info() != Eigen::Success) return {};
  result.w = numerics::largest_eigenvalue(N * of_S.solve(N.transpose()));
  // Mm - rho E C E' > 0 exactly when rho times the largest eigenvalue of H' C H is below 1.
  const MatrixXd E = MatrixXd::Identity(m + n, m + n).rightCols(n);
  const MatrixXd H = Eigen::LLT<MatrixXd>(Mm.solve(E).bottomRows(n)).matrixL();
  ErrorForm along = form;
  for (Index j = 0; j < n; ++j) {
    MatrixXd sum = MatrixXd::Zero(n, n);
    for (Index i = 0; i < n; ++i) sum += L(i, j) * form.C[static_cast<std::size_t>(i)];
    along.C[static_cast<std::size_t>(j)] = sum;
  }
  along.M = numerics::inverse(H * H.transpose());
  double most = 1e-300;
  for (const MatrixXd& C : coriolis_bounds(along, corners)) {
    most = std::max(most, numerics::largest_eigenvalue(H.transpose() * C * H));
  }
  constexpr double strictly_below = 1 - 1e-9;
  result.rho = strictly_below / most;
  return result;
}

/// The variables of the search: the entries of P, those of N, rho, and k with N S^-1 N' <= k.
class WeightProgramme {
 public:
  WeightProgramme(const FormEntries& entries, const VectorXd& size, double rate)
      : entries_(entries), size_(size), rate_(rate) {}

  void add(const ErrorForm& form) {
    add_decrease(form);
    add_shape(form);
  }

  /// Returns the start with P of the typical size and nothing else.
  [[nodiscard]] VectorXd start() const {
    return variables({size_.asDiagonal(), MatrixXd::Zero(joints_, size_.size())}, 1e-3, 1);
  }
  [[nodiscard]] VectorXd variables(const FormWeights& weights, double rho, double k) const {
    VectorXd x(count());
    Index i = 0;
    for (const auto& [row, column] : entries_.P) x[i++] = weights.P(row, column);
    for (const auto& [row, column] : entries_.N) x[i++] = weights.N(row, column);
    x[rho_] = rho;
    x[rho_ + 1] = k;
    return x;
  }
  [[nodiscard]] FormWeights weights(const VectorXd& x) const {
    FormWeights result{MatrixXd::Zero(size_.size(), size_.size()),
                       MatrixXd::Zero(joints_, size_.size())};
    Index i = 0;
    for (const auto& [row, column] : entries_.P) {
      result.P(row, column) = result.P(column, row) = x[i++];
    }
    for (const auto& [row, column] : entries_.N) result.N(row, column) = x[i++];
    return result;
  }

  /// Returns the weights of the largest rho^2 / k from weights on, or from the start.
  [[nodiscard]] std::optional<FormWeights> solution(const std::optional<FormWeights>& from) {
    add_bounds();
    const auto begin =
        numerics::feasible_point(inequalities_, from ? variables(*from, 1e-3, 1) : start());
    if (!begin) return {};
    // 2 log rho - log k. Its second part is not concave, and counts by its slope alone.
    const numerics::Objective objective = [&](const VectorXd& x) {
      const double rho = x[rho_], k = x[rho_ + 1];
      numerics::Concave f{2 * std::log(rho) - std::log(k), VectorXd::Zero(count()),
                          VectorXd::Zero(count())};
      f.gradient[rho_] = 2 / rho;
      f.gradient[rho_ + 1] = -1 / k;
      f.curvature[rho_] = 2 / (rho * rho);
      return f;
    };
    return weights(numerics::interior_maximum(inequalities_, objective, *begin, 0.05));
  }

 private:
  [[nodiscard]] Index count() const { return rho_ + 2; }

  /// 0 < rho, 0 < k, and bounds above so wide that they bind no result. Without them the barrier
  /// would grow without end along directions that the inequalities leave open.
  void add_bounds() {
    const auto number = [](Index variable, double constant, double factor) {
      return MatrixInequality{MatrixXd::Constant(1, 1, constant),
                              MatrixXd::Ones(1, 1),
                              {{variable, 0, 0, factor}},
                              VectorXd::Constant(1, std::max(1.0, constant))};
    };
    inequalities_.push_back(number(rho_, 0, 1));
    inequalities_.push_back(number(rho_, 1e4, -1));
    inequalities_.push_back(number(rho_ + 1, 0, 1));
    inequalities_.push_back(number(rho_ + 1, 100, -1));
    MatrixInequality below{MatrixXd(100 * size_.asDiagonal().toDenseMatrix()),
                           MatrixXd::Identity(size_.size(), size_.size()),
                           {},
                           size_};
    Index variable = 0;
    for (const auto& [row, column] : entries_.P) {
      below.terms.push_back({variable++, row, column, row == column ? -1.0 : -2.0});
    }
    inequalities_.push_back(std::move(below));
  }

  /// Mm - rho sym C(q, x) >= rate/2 of V's matrix. The rate is as a faster decay of all states.
  void add_decrease(const ErrorForm& form) {
    constexpr int corners = 6;
    const Index m = size_.size(), n = form.M.rows();
    joints_ = n;
    const double half = rate_ / 2;
    const MatrixXd damping = form.damping.asDiagonal();
    MatrixInequality base;
    base.constant = MatrixXd::Zero(m + n, m + n);
    base.constant.topRightCorner(m, n) = -0.5 * form.Gam.transpose();
    base.constant.bottomLeftCorner(n, m) = -0.5 * form.Gam;
    base.constant.bottomRightCorner(n, n) = symmetric_part(form.Cd) + damping - half * form.M;
    // Columns: the units of y, the rows of ydot, those of M edot and those of the torque of N.
    base.vectors = MatrixXd::Zero(m + n, 2 * m + 2 * n);
    base.vectors.topLeftCorner(m, m).setIdentity();
    base.vectors.block(0, m, m, m) = form.Fy.transpose() + half * MatrixXd::Identity(m, m);
    base.vectors.block(m, m, n, m) = form.Fe.transpose();
    base.vectors.block(m, 2 * m, n, n) = form.M;
    base.vectors.block(0, 2 * m + n, m, n) = form.Gam.transpose();
    base.vectors.block(m, 2 * m + n, n, n) =
        (form.Cd.transpose() - form.Cd - damping + half * form.M).transpose();
    Index variable = 0;
    for (const auto& [row, column] : entries_.P) {
      base.terms.push_back({variable, row, m + column, -1});
      if (row != column) base.terms.push_back({variable, column, m + row, -1});
      ++variable;
    }
    for (const auto& [row, column] : entries_.N) {
      base.terms.push_back({variable, m + column, 2 * m + row, -1});
      base.terms.push_back({variable, column, 2 * m + n + row, -1});
      ++variable;
    }
    rho_ = variable;
    const double of_rates = form.Fy.diagonal().cwiseAbs().maxCoeff();
    base.size = VectorXd(m + n);
    base.size << of_rates * size_, of_rates * form.M.diagonal();
    for (const MatrixXd& C : coriolis_bounds(form, corners)) {
      MatrixInequality each = base;
      const Index first = each.vectors.cols();
      each.vectors.conservativeResize(Eigen::NoChange, first + 2 * n);
      each.vectors.rightCols(2 * n).setZero();
      each.vectors.bottomRightCorner(n, n) = C;
      each.vectors.block(m, first, n, n).setIdentity();
      for (Index i = 0; i < n; ++i) each.terms.push_back({rho_, first + i, first + n + i, -1});
      inequalities_.push_back(std::move(each));
    }
  }

  /// [k 1, N, 0; N', P, N' M; 0, M N, M] >= 0: V is positive and N S^-1 N' <= k.
  void add_shape(const ErrorForm& form) {
    const Index m = size_.size(), n = form.M.rows();
    MatrixInequality each;
    each.constant = MatrixXd::Zero(m + 2 * n, m + 2 * n);
    each.constant.bottomRightCorner(n, n) = form.M;
    each.vectors = MatrixXd::Zero(m + 2 * n, m + 2 * n);
    each.vectors.topLeftCorner(m + n, m + n).setIdentity();
    each.vectors.topRightCorner(n, n).setIdentity();  // unit i beside row i of M
    each.vectors.bottomRightCorner(n, n) = form.M;
    Index variable = 0;
    for (const auto& [row, column] : entries_.P) {
      each.terms.push_back({variable++, n + row, n + column, row == column ? 1.0 : 2.0});
    }
    for (const auto& [row, column] : entries_.N) {
      each.terms.push_back({variable++, n + column, n + m + row, 2});
    }
    for (Index i = 0; i < n; ++i) each.terms.push_back({rho_ + 1, i, i, 1});
    each.size = VectorXd(m + 2 * n);
    each.size << VectorXd::Ones(n), size_, form.M.diagonal();
    inequalities_.push_back(std::move(each));
  }

  const FormEntries& entries_;
  VectorXd size_;
  double rate_;
  Index joints_ = 0, rho_ = 0;
  std::vector<MatrixInequality> inequalities_;
};

}  // namespace

MatrixXd lyapunov_matrix(const ErrorForm& form, const FormWeights& weights) {
  const Index m = form.Fy.rows(), n = form.M.rows();
  MatrixXd V(m + n, m + n);
  V.topLeftCorner(m, m) = weights.P;
  V.topRightCorner(m, n) = weights.N.transpose() * form.M;
  V.bottomLeftCorner(n, m) = form.M * weights.N;
  V.bottomRightCorner(n, n) = form.M;
  return V;
}

MatrixXd decrease_matrix(const ErrorForm& form, const FormWeights& weights) {
  const Index m = form.Fy.rows(), n = form.M.rows();
  const auto& [P, N] = weights;
  const MatrixXd D = form.damping.asDiagonal();
  MatrixXd X = MatrixXd::Zero(m + n, m + n);
  X.topLeftCorner(m, m) = P * form.Fy + N.transpose() * form.Gam;
  X.topRightCorner(m, n) = P * form.Fe + form.Fy.transpose() * N.transpose() * form.M +
                           N.transpose() * (form.Cd.transpose() - form.Cd - D) +
                           form.Gam.transpose();
  X.bottomRightCorner(n, n) = -form.Cd - D + (N * form.Fe).transpose() * form.M;
  return -symmetric_part(X);
}

MatrixXd delta_norm(const FormWeights& weights) {
  const Eigen::LLT<MatrixXd> of_P(weights.P);
  return Eigen::LLT<MatrixXd>(weights.N * of_P.solve(weights.N.transpose())).matrixL();
}

FormRegion region_of(const std::vector<ErrorForm>& forms, const FormWeights& weights) {
  if (Eigen::LLT<MatrixXd>(weights.P).info() != Eigen::Success) return {};
  const MatrixXd L = delta_norm(weights);
  return region_of(
      base::parallel_map(forms.size(), [&](std::size_t i) { return at(forms[i], weights, L); }));
}

FormRegion region_of(const std::vector<FormResult>& all) {
  FormRegion region{0, infinity, infinity, 0};
  double w = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    w = std::max(w, all[i].w);
    region.rate = std::min(region.rate, all[i].rate);
    if (all[i].rho >= region.rho) continue;
    region.rho = all[i].rho;
    region.binding = i;
  }
  if (region.rho > 0) region.level = region.rho * region.rho / (2 * w);
  return region;
}

std::optional<FormWeights> best_form_weights(const std::vector<ErrorForm>& forms,
                                             const FormEntries& entries, const VectorXd& size,
                                             double rate, const std::optional<FormWeights>& from) {
  WeightProgramme programme(entries, size, rate);
  for (const ErrorForm& form : forms) programme.add(form);
  return programme.solution(from);
}

}  // namespace tachless::lyapunov

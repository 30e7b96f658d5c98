#include "numerics/matrix_inequalities.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

#include "base/parallel.h"
#include "numerics/decompositions.h"

namespace tachless::numerics {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// log det F(x) of one inequality, or of several, with its derivatives.
struct Barrier {
  VectorXd gradient;
  MatrixXd curvature;  ///< minus the second derivative
};

/// Returns log det F(x); minus infinity where F(x) is not positive definite.
double log_det(const MatrixInequality& inequality, const VectorXd& x) {
  const Eigen::LLT<MatrixXd> llt(inequality.at(x));
  if (llt.info() != Eigen::Success) return -std::numeric_limits<double>::infinity();
  const double sum = 2 * MatrixXd(llt.matrixL()).diagonal().array().log().sum();
  return std::isfinite(sum) ? sum : -std::numeric_limits<double>::infinity();
}

double log_det(const std::vector<MatrixInequality>& inequalities, const VectorXd& x) {
  double sum = 0;
  for (const MatrixInequality& each : inequalities) {
    sum += log_det(each, x);
    if (std::isinf(sum)) break;
  }
  return sum;
}

/// With Q = U' F^-1 U, tr(F^-1 sym(u v')) = Q_uv and tr(F^-1 sym(u v') F^-1 sym(a b')) =
/// (Q_ua Q_vb + Q_ub Q_va) / 2.
Barrier barrier_at(const MatrixInequality& inequality, const VectorXd& x) {
  const Eigen::LLT<MatrixXd> llt(inequality.at(x));
  const MatrixXd half = llt.matrixL().solve(inequality.vectors);
  const MatrixXd Q = half.transpose() * half;
  Barrier result{VectorXd::Zero(x.size()), MatrixXd::Zero(x.size(), x.size())};
  const auto& terms = inequality.terms;
  for (std::size_t i = 0; i < terms.size(); ++i) {
    const auto& s = terms[i];
    result.gradient[s.variable] += s.factor * Q(s.left, s.right);
    for (std::size_t j = 0; j < terms.size(); ++j) {
      const auto& t = terms[j];
      if (t.variable > s.variable) continue;
      result.curvature(s.variable, t.variable) +=
          0.5 * s.factor * t.factor *
          (Q(s.left, t.left) * Q(s.right, t.right) + Q(s.left, t.right) * Q(s.right, t.left));
    }
  }
  return result;
}

Barrier barrier_at(const std::vector<MatrixInequality>& inequalities, const VectorXd& x) {
  const auto all = base::parallel_map(
      inequalities.size(), [&](std::size_t i) { return barrier_at(inequalities[i], x); });
  Barrier sum{VectorXd::Zero(x.size()), MatrixXd::Zero(x.size(), x.size())};
  for (const Barrier& each : all) {
    sum.gradient += each.gradient;
    sum.curvature += each.curvature;
  }
  sum.curvature.triangularView<Eigen::StrictlyUpper>() = sum.curvature.transpose();
  return sum;
}

/// Returns the step of Newton's method; variables may differ by many orders of magnitude.
VectorXd newton_step(const MatrixXd& curvature, const VectorXd& gradient) {
  const VectorXd scale = curvature.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  MatrixXd scaled = scale.asDiagonal() * curvature * scale.asDiagonal();
  scaled.diagonal().array() += 1e-12;
  return scale.asDiagonal() * scaled.ldlt().solve(scale.cwiseProduct(gradient));
}

/// How a search of the centre ended.
enum class End { centred, done, tired };

/// Makes weight times the objective plus the barrier large from x on, until `done` says so.
End centre(const std::vector<MatrixInequality>& inequalities, const Objective& objective,
           double weight, VectorXd& x, const std::function<bool(const VectorXd&)>& done) {
  constexpr int most_steps = 40;
  double merit = weight * objective(x).value + log_det(inequalities, x);
  for (int step = 0; step < most_steps; ++step) {
    const Concave f = objective(x);
    Barrier barrier = barrier_at(inequalities, x);
    barrier.gradient += weight * f.gradient;
    barrier.curvature.diagonal() += weight * f.curvature;
    const VectorXd d = newton_step(barrier.curvature, barrier.gradient);
    const double promised = barrier.gradient.dot(d);
    if (!(promised > 0.5)) return End::centred;
    double part = 1, next = -std::numeric_limits<double>::infinity();
    for (int halvings = 0; halvings < 40; ++halvings, part /= 2) {
      const VectorXd y = x + part * d;
      const double inside = log_det(inequalities, y);
      if (!std::isfinite(inside)) continue;
      next = weight * objective(y).value + inside;
      if (next >= merit + 0.01 * part * promised) break;
    }
    if (!(next > merit)) return End::tired;
    x += part * d;
    merit = next;
    if (done && done(x)) return End::done;
  }
  return End::tired;
}

/// The growth of the weight from one centre to the next. With 10 the steps end so near the border
/// that they lose their precision.
constexpr double growth = 3;

double degree_of(const std::vector<MatrixInequality>& inequalities) {
  double degree = 0;
  for (const MatrixInequality& each : inequalities) degree += static_cast<double>(each.size.size());
  return degree;
}

}  // namespace

MatrixXd MatrixInequality::at(const VectorXd& x) const {
  MatrixXd products = MatrixXd::Zero(vectors.cols(), vectors.cols());
  for (const Term& term : terms) {
    products(term.left, term.right) += x[term.variable] * term.factor;
  }
  const MatrixXd sum = vectors * products * vectors.transpose();
  return constant + 0.5 * (sum + sum.transpose());
}

VectorXd interior_maximum(const std::vector<MatrixInequality>& inequalities,
                          const Objective& objective, const VectorXd& start, double gap) {
  VectorXd x = start;
  const double degree = degree_of(inequalities);
  for (double weight = 1; weight < growth * degree / gap; weight *= growth) {
    centre(inequalities, objective, std::min(weight, degree / gap), x, {});
  }
  return x;
}

std::optional<VectorXd> feasible_point(const std::vector<MatrixInequality>& inequalities,
                                       const VectorXd& start) {
  if (std::isfinite(log_det(inequalities, start))) return start;
  // One more variable s, and F(x) - s diag(size) > 0: the largest s.
  const Index n = start.size();
  double least = 0;
  std::vector<MatrixInequality> with_slack = inequalities;
  for (MatrixInequality& each : with_slack) {
    const VectorXd inverse = each.size.cwiseSqrt().cwiseInverse();
    least = std::min(
        least, smallest_eigenvalue(inverse.asDiagonal() * each.at(start) * inverse.asDiagonal()));
    const Index first = each.vectors.cols();
    each.vectors.conservativeResize(Eigen::NoChange, first + each.size.size());
    each.vectors.rightCols(each.size.size()) = each.size.cwiseSqrt().asDiagonal();
    for (Index i = 0; i < each.size.size(); ++i) {
      each.terms.push_back({n, first + i, first + i, -1});
    }
  }
  VectorXd x(n + 1);
  x << start, 1.5 * least - 1e-3;
  const Objective slack = [&](const VectorXd& y) {
    return Concave{y[n], VectorXd::Unit(n + 1, n), VectorXd::Zero(n + 1)};
  };
  const auto done = [&](const VectorXd& y) { return y[n] > 0; };
  // The weights at which the barrier and the slack are alike, up to where the barrier is nothing.
  const double degree = degree_of(with_slack);
  for (double weight = degree / std::abs(x[n]); weight < 1e7 * degree; weight *= growth) {
    const End end = centre(with_slack, slack, weight, x, done);
    if (end == End::done) return x.head(n);
    if (end == End::centred && x[n] + 2 * degree / weight < 0) return {};
  }
  return {};
}

}  // namespace tachless::numerics

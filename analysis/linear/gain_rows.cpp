#include "linear/gain_rows.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>

#include "numerics/decompositions.h"

namespace tachless::linear {
namespace {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXcd;
using Eigen::VectorXd;

constexpr int num_frequencies = 80;
constexpr double lowest_rad_per_s = 1;
constexpr Eigen::Index instants_together = 16, few_instants = 256;

/// Only the rows of one joint, of vectors that each have an entry per joint.
MatrixXd rows_of_joint(const MatrixXd& all, Index joint, Index n) {
  MatrixXd own = MatrixXd::Zero(all.rows(), all.cols());
  for (Index i = joint; i < all.rows(); i += n) own.row(i) = all.row(i);
  return own;
}

/// Returns the scaling T that makes T^-1 L T nearly normal: P is near M^-1 times a number, and K is
/// diagonal.
VectorXd scale_of(const MatrixXcd& K) { return K.rowwise().norm().cwiseSqrt().cwiseMax(1e-30); }

/// Replaces a small matrix by its inverse, with pivots by columns: a third of the time of an LU
/// decomposition for any size. A singular matrix gets entries that are not finite.
void invert(MatrixXcd& A) {
  const Index n = A.rows();
  std::array<Index, max_joints> pivot{};
  for (Index k = 0; k < n; ++k) {
    Index& p = pivot[static_cast<std::size_t>(k)];
    A.row(k).tail(n - k).cwiseAbs2().maxCoeff(&p);
    p += k;
    A.col(k).swap(A.col(p));
    const std::complex<double> by = 1.0 / A(k, k);
    A(k, k) = 1;
    A.col(k) *= by;
    for (Index j = 0; j < n; ++j) {
      if (j == k) continue;
      const std::complex<double> factor = A(k, j);
      A(k, j) = 0;
      A.col(j) -= factor * A.col(k);
    }
  }
  for (Index k = n; k-- > 0;) A.row(k).swap(A.row(pivot[static_cast<std::size_t>(k)]));
}

/// Returns the map S of a law whose memory is one vector of joints after another, each joint with
/// the same filter: A = S x I. Returns an empty matrix for another law.
MatrixXd same_filter(const LinearLaw& law) {
  constexpr double rounding = 1e-14;
  const Index n = law.D.rows(), order = law.A.rows() / n;
  if (order == 0 || order * n != law.A.rows()) return {};
  MatrixXd S(order, order);
  for (Index i = 0; i < order * order; ++i) {
    const auto block = law.A.block(i % order * n, i / order * n, n, n);
    const double own = S(i % order, i / order) = block(0, 0);
    if ((block - own * MatrixXd::Identity(n, n)).cwiseAbs().maxCoeff() > rounding) return {};
  }
  return S;
}

/// No eigenvalue is nearer to 0 than Gershgorin's discs.
double least_by_discs(const MatrixXcd& A) {
  const MatrixXd size = A.cwiseAbs2().cwiseSqrt();
  return (2 * size.diagonal() - size.rowwise().sum()).minCoeff();
}

}  // namespace

LinearLaw Feedback::derivative(Index variable) const {
  if (!by_joint) return by_kind[static_cast<std::size_t>(variable)];
  const Index n = law.D.rows(), joint = variable % n;
  const LinearLaw& all = by_kind[static_cast<std::size_t>(variable / n)];
  const auto own = [&](const MatrixXd& each) { return rows_of_joint(each, joint, n); };
  return {own(all.A), own(all.B), own(all.C), own(all.D), law.measured};
}

FeedbackAt at_frequency(const Feedback& feedback, double w, double period_s) {
  const LinearLaw& law = feedback.law;
  FeedbackAt at{w, law.D.cast<std::complex<double>>(), {}};
  const Index memory = law.A.rows();
  MatrixXcd to_memory, from_memory;  // (z - A)^-1 B, C (z - A)^-1
  if (memory > 0) {
    const std::complex<double> z = std::polar(1.0, w * period_s);
    if (law.A.isDiagonal(0)) {  // each state is a filter of its own
      const VectorXcd inverse = (z - law.A.diagonal().array()).inverse();
      to_memory = inverse.asDiagonal() * law.B;
      from_memory = law.C * inverse.asDiagonal();
    } else {
      MatrixXcd resolvent = -law.A.cast<std::complex<double>>();
      resolvent.diagonal().array() += z;
      const MatrixXcd inverse = numerics::complex_inverse(resolvent);
      to_memory = inverse * law.B;
      from_memory = law.C * inverse;
    }
    at.K += law.C * to_memory;
  }
  for (const LinearLaw& by : feedback.by_kind) {
    at.by_kind.emplace_back(by.D);
    if (memory == 0) continue;
    at.by_kind.back() +=
        by.C * to_memory + from_memory * (by.B.cast<std::complex<double>>() + by.A * to_memory);
  }
  return at;
}

std::vector<FeedbackAt> at_frequencies(const Feedback& feedback, const std::vector<double>& w,
                                       double period_s) {
  const LinearLaw& law = feedback.law;
  std::vector<FeedbackAt> all;
  all.reserve(w.size());
  const MatrixXd filter = same_filter(law);
  if (filter.size() == 0 || !feedback.by_kind.empty()) {
    for (const double each : w) all.push_back(at_frequency(feedback, each, period_s));
    return all;
  }
  const Index n = law.D.rows(), order = filter.rows();
  std::vector<MatrixXd> through;  // C and B of each pair of the filter's states
  for (Index i = 0; i < order * order; ++i) {
    through.emplace_back(law.C.middleCols(i % order * n, n) * law.B.middleRows(i / order * n, n));
  }
  for (const double each : w) {
    MatrixXcd resolvent = -filter.cast<std::complex<double>>();
    resolvent.diagonal().array() += std::polar(1.0, each * period_s);
    invert(resolvent);
    all.push_back({each, law.D.cast<std::complex<double>>(), {}});
    for (Index i = 0; i < order * order; ++i) {
      all.back().K += resolvent(i % order, i / order) * through[static_cast<std::size_t>(i)];
    }
  }
  return all;
}

std::vector<double> kept_frequencies(double period_s) {
  const double highest = 0.999 * std::numbers::pi / period_s;
  std::vector<double> w;
  for (int k = 0; k < num_frequencies; ++k) {
    w.push_back(lowest_rad_per_s * std::pow(highest / lowest_rad_per_s,
                                            static_cast<double>(k) / (num_frequencies - 1)));
  }
  return w;
}

RestLoop::RestLoop(const LinearPlant& plant, const LinearLaw& law, double period_s, int delay,
                   bool keeps_responses)
    : n_(plant.num_joints), period_s_(period_s) {
  LinearLaw compensation{MatrixXd(0, 0),  MatrixXd(0, law.D.cols()),
                         MatrixXd(n_, 0), law.compensation,
                         law.measured,    law.compensation};
  const CutLoop loop = cut(plant, compensation, period_s, delay);
  A_ = loop.A;
  B_ = loop.B;
  C_ = measured_rows(law.measured, n_, A_.rows());
  displaced_ = displaced(plant, A_.rows());
  const numerics::ComplexSchur schur = numerics::complex_schur(A_);
  T_ = schur.T;
  input_ = schur.U.adjoint() * B_;
  output_ = C_ * schur.U;
  if (!keeps_responses) return;
  w_ = kept_frequencies(period_s);
  for (const double w : w_) at_w_.push_back(solved_response(w));
}

MatrixXd RestLoop::closed(const LinearLaw& law) const {
  const Index x = A_.rows(), m = law.A.rows();
  MatrixXd map(x + m, x + m);
  map << A_ + B_ * (law.D * C_), B_ * law.C, law.B * C_, law.A;
  return map;
}

MatrixXd RestLoop::starts(const LinearLaw& law) const {
  MatrixXd state(A_.rows() + law.A.rows(), n_);
  state << displaced_, first_memory(law, C_ * displaced_);
  return state;
}

MatrixXcd RestLoop::response(double w) const {
  const auto kept = std::ranges::lower_bound(w_, w);
  if (kept != w_.end() && *kept == w) return at_w_[static_cast<std::size_t>(kept - w_.begin())];
  return solved_response(w);
}

MatrixXcd RestLoop::solved_response(double w) const {
  MatrixXcd resolvent = -T_;
  resolvent.diagonal().array() += std::polar(1.0, w * period_s_);
  const MatrixXcd state = resolvent.triangularView<Eigen::Upper>().solve(input_);
  return output_ * state;
}

RestLoop::ReturnDifference RestLoop::return_difference(const FeedbackAt& at) const {
  const VectorXd scale = scale_of(at.K);
  const MatrixXcd P = response(at.w);
  MatrixXcd L;
  if (at.K.rows() == at.K.cols() && at.K.isDiagonal(0)) {
    L = at.K.diagonal().asDiagonal() * P;
  } else {
    L = at.K * P;
  }
  MatrixXcd one_plus = -(scale.cwiseInverse().asDiagonal() * L * scale.asDiagonal());
  one_plus.diagonal().array() += 1;
  const double bound = least_by_discs(one_plus);
  return {std::move(one_plus), bound};
}

namespace {

/// Returns the least absolute eigenvalue, or a smaller number above `enough`.
/// @param bound no eigenvalue is nearer to 0
double least_eigenvalue(const MatrixXcd& A, double bound, double enough) {
  if (bound > enough) return bound;
  // No eigenvalue is smaller than 1 / |inverse^k|^(1/k), which comes near the least as k grows.
  MatrixXcd inverse = A;
  invert(inverse);
  bound = 1 / inverse.norm();
  for (int k = 2; bound <= enough && k <= 8; k *= 2) {
    inverse = inverse.lazyProduct(inverse).eval();
    bound = std::pow(inverse.norm(), -1.0 / k);
  }
  return bound > enough ? bound : numerics::eigenvalues(A).cwiseAbs().minCoeff();
}

}  // namespace

std::vector<double> RestLoop::modulus(const std::vector<FeedbackAt>& grid, double enough) const {
  std::vector<double> all;
  for (const FeedbackAt& at : grid) {
    const ReturnDifference here = return_difference(at);
    all.push_back(least_eigenvalue(here.matrix, here.bound, enough));
  }
  return all;
}

double RestLoop::least_modulus(const std::vector<FeedbackAt>& grid, double enough) const {
  // Eigenvalues cost ten times as much as a bound. The least bound is tried first, so that few
  // frequencies need them.
  std::vector<ReturnDifference> all;
  all.reserve(grid.size());
  for (const FeedbackAt& at : grid) all.push_back(return_difference(at));
  std::ranges::sort(all, {}, &ReturnDifference::bound);
  double least = infinity;
  for (const ReturnDifference& each : all) {
    if (each.bound > std::min(least, enough)) return std::min(least, each.bound);
    least = std::min(least, least_eigenvalue(each.matrix, each.bound, std::min(least, enough)));
  }
  return least;
}

void RestLoop::add_rows(const FeedbackAt& at, const Feedback& feedback, double least, double near,
                        std::vector<numerics::LinearProgramme::Row>& rows) const {
  const MatrixXcd P = response(at.w);
  const VectorXd scale = scale_of(at.K);
  const auto scaled = [&](const MatrixXcd& K) -> MatrixXcd {
    return -(scale.cwiseInverse().asDiagonal() * (K * P) * scale.asDiagonal());
  };
  const numerics::ComplexEigen eigen = numerics::complex_eigen(scaled(at.K));
  const MatrixXcd left = numerics::complex_inverse(eigen.vectors);
  const Index variables = std::ssize(at.by_kind) * (feedback.by_joint ? n_ : 1);
  for (Index m = 0; m < n_; ++m) {
    const std::complex<double> from = eigen.values[m] + 1.0;
    const double distance = std::abs(from);
    if (distance > least + near) continue;
    numerics::LinearProgramme::Row row{VectorXd(variables), least - distance};
    for (std::size_t kind = 0; kind < at.by_kind.size(); ++kind) {
      const VectorXcd moved = scaled(at.by_kind[kind]) * eigen.vectors.col(m);
      const VectorXd change =
          (std::conj(from) / distance * left.row(m).transpose().cwiseProduct(moved).array()).real();
      const auto first = static_cast<Index>(kind);
      if (feedback.by_joint) {
        row.gradient.segment(first * n_, n_) = change;
      } else {
        row.gradient[first] = change.sum();
      }
    }
    rows.push_back(std::move(row));
  }
}

VectorXd Errors::last_unsettled_s() const {
  const Index n = std::llround(std::sqrt(error.cols()));
  VectorXd last = VectorXd::Zero(n);
  for (Index k = 0; k < error.rows(); ++k) {
    for (Index joint = 0; joint < n; ++joint) {
      const double largest = error.row(k).segment(joint * n, n).cwiseAbs().maxCoeff();
      if (!(largest <= settled)) last[joint] = time_s[static_cast<std::size_t>(k)];
    }
  }
  return last;
}

Errors errors(const RestLoop& loop, const LinearLaw& feedback, double begin_s, double end_s,
              int most_instants) {
  return errors(loop.closed(feedback), loop.starts(feedback), loop.period_s(), begin_s, end_s,
                most_instants);
}

Errors errors(const MatrixXd& map, const MatrixXd& starts, double period_s, double begin_s,
              double end_s, int most_instants) {
  const double h = period_s;
  const Index n = starts.cols();
  auto first = std::max<long long>(1, std::llround(begin_s / h));
  const auto last = std::max(first + 1, std::llround(end_s / h));
  long long stride = 1;
  while ((last - first) / stride > most_instants) stride *= 2;
  MatrixXd power = map, step = power, state = starts, here;
  for (long long bit = 1, rest = first; bit <= std::max(first, stride); bit *= 2) {
    if (bit == stride) step = power;
    if (rest % 2 == 1) state = power * state;
    rest /= 2;
    power = power * power;
  }
  Errors result;
  result.error.resize((last - first) / stride + 1, n * n);
  // The errors of several instants follow from the state at the first of them.
  const Index together = result.error.rows() < few_instants ? 1 : instants_together;
  MatrixXd seen = MatrixXd::Identity(together * n, state.rows());
  for (Index i = 1; i < together; ++i) {
    seen.middleRows(i * n, n) = seen.middleRows((i - 1) * n, n) * step;
  }
  const MatrixXd on = linear::power(step, together);
  for (Index k = 0; k < result.error.rows(); ++k) {
    result.time_s.push_back(h * static_cast<double>(first + k * stride));
    if (k > 0 && k % together == 0) state = on * state;
    if (k % together == 0) here = seen * state;
    const MatrixXd now = here.middleRows(k % together * n, n);
    result.error.row(k) = Eigen::Map<const Eigen::RowVectorXd>(now.data(), n * n);
  }
  return result;
}

}  // namespace tachless::linear

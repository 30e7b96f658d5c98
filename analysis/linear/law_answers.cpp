#include "linear/law_answers.h"

#include <fmt/format.h>

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <random>
#include <vector>

#include "numerics/decompositions.h"

namespace tachless::linear {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double small = 1e-6, factor = 10;  // [rad; m, rad/s; m/s]
constexpr double agreement = 1e-4;           // of the largest answer
constexpr Index rest_ticks = 4;              // before a pulse: what a law does at its start only
constexpr double rounding = 64 * std::numeric_limits<double>::epsilon();

double largest(const MatrixXd& x) { return x.size() == 0 ? 0 : x.cwiseAbs().maxCoeff(); }

/// Returns the odd part of the answer to deviations: all that is linear, nothing quadratic.
MatrixXd odd_part(const Ask& ask, const MatrixXd& deviations) {
  return (ask(deviations) - ask(-deviations)) / 2;
}

/// Torque per deviation in the ticks after a pulse in one input after the other, [joints x inputs].
std::vector<MatrixXd> pulse_answers(const Ask& ask, Index inputs, Index window) {
  std::vector<MatrixXd> all(static_cast<std::size_t>(window));
  for (Index j = 0; j < inputs; ++j) {
    MatrixXd deviations = MatrixXd::Zero(inputs, rest_ticks + window);
    deviations(j, rest_ticks) = small;
    const MatrixXd answer = odd_part(ask, deviations) / small;
    for (Index k = 0; k < window; ++k) {
      MatrixXd& h = all[static_cast<std::size_t>(k)];
      if (j == 0) h.resize(answer.rows(), inputs);
      h.col(j) = answer.col(rest_ticks + k);
    }
  }
  return all;
}

/// Returns the same law with its states counted by pulses that lead to them. The first independent
/// pulses count, so models of one law with several gains have the same states.
LinearLaw in_pulses(const LinearLaw& law) {
  constexpr double independent = 1e-9;
  const Index r = law.A.rows();
  MatrixXd columns(r, r), directions(r, r);
  Index found = 0;
  MatrixXd reached = law.B;
  for (Index k = 0; k < r && found < r; ++k, reached = law.A * reached) {
    for (Index j = 0; j < reached.cols() && found < r; ++j) {
      VectorXd rest = reached.col(j);
      for (int twice = 0; twice < 2; ++twice) {
        rest -= directions.leftCols(found) * (directions.leftCols(found).transpose() * rest);
      }
      if (rest.norm() <= independent * reached.norm()) continue;  // of all: one may lead to none
      columns.col(found) = reached.col(j);
      directions.col(found++) = rest.normalized();
    }
  }
  if (found < r || r == 0) return law;
  const MatrixXd inverse = numerics::inverse(columns);
  return {inverse * law.A * columns, inverse * law.B, law.C * columns, law.D, {}, {}};
}

/// Returns the rounding of each joint in answers to pulses [N m/rad]. The sum of the answers has
/// one rounding for each term; the rounding is how much the answer to `given` in the first ticks
/// differs from it.
VectorXd rounding_of(const std::vector<MatrixXd>& h, const MatrixXd& given,
                     const MatrixXd& answer) {
  constexpr double least = 1e-13;  // of the largest answer
  VectorXd noise = VectorXd::Zero(answer.rows());
  for (const MatrixXd& each : h)
    noise = noise.cwiseMax(least * each.cwiseAbs().rowwise().maxCoeff());
  for (Index k = 0; k < std::ssize(h); ++k) {
    VectorXd rest = answer.col(rest_ticks + k);
    for (Index i = 0; i <= k; ++i) {
      rest -= h[static_cast<std::size_t>(i)] * given.col(rest_ticks + k - i);
    }
    const auto terms = static_cast<double>((k + 1) * given.rows());
    noise = noise.cwiseMax(rest.cwiseAbs() / (largest(given) * std::sqrt(terms)));
  }
  return (noise.array() == 0).select(1, noise);
}

/// @param noise of each joint, the unit in which its rows count
LinearLaw model_of(const std::vector<MatrixXd>& h, const VectorXd& noise) {
  const Index n = h[0].rows(), m = h[0].cols(), blocks = (static_cast<Index>(h.size()) - 1) / 2;
  MatrixXd hankel(blocks * n, blocks * m), shifted = hankel;
  const VectorXd weight = noise.cwiseInverse();
  for (Index i = 0; i < blocks; ++i) {
    for (Index j = 0; j < blocks; ++j) {
      const auto k = static_cast<std::size_t>(i + j);
      hankel.block(i * n, j * m, n, m) = weight.asDiagonal() * h[k + 1];
      shifted.block(i * n, j * m, n, m) = weight.asDiagonal() * h[k + 2];
    }
  }
  // The SVD is that of the triangle's first rows, which have all but rounding. It is as exact as
  // the answers, whatever their scale. Eigen's divide and conquer is not: it finds a value of 1e-6
  // of the largest too many.
  const double least = 64 * std::sqrt(static_cast<double>(blocks * std::max(n, m)));
  const Eigen::ColPivHouseholderQR<MatrixXd> qr(hankel);
  const MatrixXd triangle = qr.matrixR().template triangularView<Eigen::Upper>();
  const Index rows =
      std::max<Index>(1, (qr.matrixR().diagonal().cwiseAbs().array() > least / 64).count());
  const numerics::Singular svd =
      numerics::singular(MatrixXd(triangle.topRows(rows)) * qr.colsPermutation().transpose());
  const Index r = (svd.values.array() > least).count();
  const VectorXd root = svd.values.head(r).cwiseSqrt(), inverse = root.cwiseInverse();
  MatrixXd observed = MatrixXd::Zero(hankel.rows(), r);
  observed.topRows(rows) = svd.U.leftCols(r);
  observed.applyOnTheLeft(qr.householderQ());
  const MatrixXd reached = svd.V.leftCols(r);
  return in_pulses(
      {inverse.asDiagonal() * (observed.transpose() * shifted * reached) * inverse.asDiagonal(),
       root.asDiagonal() * reached.topRows(m).transpose(),
       noise.asDiagonal() * observed.topRows(n) * root.asDiagonal(),
       h[0],
       {},
       {}});
}

MatrixXd foretell(const LinearLaw& law, const MatrixXd& deviations) {
  VectorXd x = VectorXd::Zero(law.A.rows());
  MatrixXd torque(law.D.rows(), deviations.cols());
  for (Index k = 0; k < deviations.cols(); ++k) {
    torque.col(k) = law.C * x + law.D * deviations.col(k);
    x = law.A * x + law.B * deviations.col(k);
  }
  return torque;
}

/// Random pulses in all inputs at once over the first quarter, then a step.
MatrixXd probe(Index inputs, Index ticks) {
  std::mt19937 random(1);
  MatrixXd all = MatrixXd::Zero(inputs, rest_ticks + ticks);
  for (Index k = 0; k < ticks; ++k) {
    for (Index j = 0; j < inputs; ++j) {
      const double pulse = static_cast<double>(random() % 3) - 1;
      all(j, rest_ticks + k) =
          small * (k < ticks / 4 ? pulse : static_cast<double>(1 - 2 * (j % 2)));
    }
  }
  return all;
}

/// Returns the largest difference as a part of each joint's answers, over all ticks and over the
/// end of the step. A filter's answer to a pulse is thousands of times the answer to a step.
/// @param noise of rounding
double disagreement(const MatrixXd& is, const MatrixXd& expected, double noise) {
  const Index last = is.cols() / 4;
  double worst = 0;
  for (Index i = 0; i < is.rows(); ++i) {
    for (const Index ticks : {is.cols(), last}) {
      const MatrixXd a = is.row(i).tail(ticks), b = expected.row(i).tail(ticks);
      worst = std::max(worst, std::max(0.0, largest(a - b) - noise) / std::max(largest(b), noise));
    }
  }
  return worst;
}

}  // namespace

MatrixXd at_once(const Ask& ask, Index inputs) { return pulse_answers(ask, inputs, 1)[0]; }

LinearLaw realised(const Ask& ask, Index inputs, Index window, Index ticks) {
  const std::vector<MatrixXd> pulses = pulse_answers(ask, inputs, window);
  const MatrixXd given = probe(inputs, ticks), large = factor * given, at_rest = ask(0 * given);
  const MatrixXd plus = ask(large), minus = ask(-large), once = (plus - minus) / 2;
  const LinearLaw law = model_of(pulses, rounding_of(pulses, large, once));
  const double noise = rounding * (largest(at_rest) + largest(once));
  const auto refuse_unless = [&](const char* what, const MatrixXd& is, const MatrixXd& expected) {
    const double by = disagreement(is, expected, 2 * static_cast<double>(inputs) * noise);
    if (by < agreement) return;
    throw NoLinearModel(
        fmt::format("its answers do not superpose: {}, by {:.2g} of it; take limits, dead bands "
                    "and signs out of the law",
                    what, by));
  };
  const MatrixXd even = (plus + minus) / 2 - at_rest;
  if (disagreement(once + even, once, noise) >= agreement) {
    // The smooth part of it is quadratic: a hundredth at a tenth of the deviations. The rest grows
    // as |x|.
    const MatrixXd less = (ask(given) + ask(-given)) / 2 - at_rest;
    const double square = factor * factor;
    refuse_unless("the answer to -1e-05 is not the opposite of the answer to 1e-05",
                  once + (square * less - even) / (factor - 1), once);
  }
  if (disagreement(once, factor * foretell(law, given), noise) < agreement) return law;
  refuse_unless("the answer to deviations of 1e-05 is not 10 times the answer to 1e-06", once,
                factor * odd_part(ask, given));
  MatrixXd sum = 0 * once;
  for (Index j = 0; j < inputs; ++j) {
    MatrixXd alone = 0 * given;
    alone.row(j) = large.row(j);
    sum += odd_part(ask, alone);
  }
  refuse_unless("the answer to all inputs is not the sum of the answers to each", once, sum);
  throw NoLinearModel(
      fmt::format("a model of {} ticks of its answers does not predict {} ticks: its memory is "
                  "longer, or it depends on the time",
                  window, ticks));
}

Index window_of(const Ask& ask, Index inputs) {
  const MatrixXd given = factor * probe(inputs, windows[0]);
  const MatrixXd once = ask(given), again = ask(given);
  if (largest(once - again) > rounding * largest(once)) {
    throw NoLinearModel(fmt::format(
        "two identical experiments differ by {:.2g} N m: it is not deterministic, or keeps its "
        "memory when a run begins anew at tick 0",
        largest(once - again)));
  }
  for (const Index window : windows) {
    try {
      realised(ask, inputs, window, foretold);
      return window;
    } catch (const NoLinearModel&) {
      if (window == *std::rbegin(windows)) throw;
    }
  }
  throw std::logic_error("linear::windows is empty");
}

}  // namespace tachless::linear

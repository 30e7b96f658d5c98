#include "certificate/law_answers.h"

#include <fmt/format.h>

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <random>
#include <vector>

#include "robot/decompositions.h"

namespace tachless::certificate {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double small = 1e-6, factor = 10;  // [rad; m, rad/s; m/s]
constexpr double agreement = 1e-4;           // of the largest answer
constexpr Index rest_ticks = 4;              // before a pulse: what a law does at its start only
constexpr double rounding = 64 * std::numeric_limits<double>::epsilon();

double largest(const MatrixXd& x) { return x.size() == 0 ? 0 : x.cwiseAbs().maxCoeff(); }

/// Torque per deviation in the ticks after a pulse in one input after the other, [joints x inputs].
std::vector<MatrixXd> pulse_answers(const Ask& ask, Index inputs, Index window, double& torque) {
  std::vector<MatrixXd> all(static_cast<std::size_t>(window));
  for (Index j = 0; j < inputs; ++j) {
    MatrixXd deviations = MatrixXd::Zero(inputs, rest_ticks + window);
    deviations(j, rest_ticks) = small;
    const MatrixXd plus = ask(deviations), minus = ask(-deviations);
    torque = std::max({torque, largest(plus), largest(minus)});
    for (Index k = 0; k < window; ++k) {
      MatrixXd& h = all[static_cast<std::size_t>(k)];
      if (j == 0) h.resize(plus.rows(), inputs);
      h.col(j) = (plus.col(rest_ticks + k) - minus.col(rest_ticks + k)) / (2 * small);
    }
  }
  return all;
}

/// The same with the states counted by pulses that lead to them, the first that are independent:
/// so that models of one law at several postures have the same states.
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
      if (rest.norm() <= independent * reached.col(j).norm()) continue;
      columns.col(found) = reached.col(j);
      directions.col(found++) = rest.normalized();
    }
  }
  if (found < r || r == 0) return law;
  const MatrixXd inverse = robot::inverse(columns);
  return {inverse * law.A * columns, inverse * law.B, law.C * columns, law.D, {}, {}};
}

LinearLaw model_of(const std::vector<MatrixXd>& h, double torque) {
  const Index n = h[0].rows(), m = h[0].cols(), blocks = (static_cast<Index>(h.size()) - 1) / 2;
  MatrixXd hankel(blocks * n, blocks * m), shifted = hankel;
  for (Index i = 0; i < blocks; ++i) {
    for (Index j = 0; j < blocks; ++j) {
      const auto k = static_cast<std::size_t>(i + j);
      hankel.block(i * n, j * m, n, m) = h[k + 1];
      shifted.block(i * n, j * m, n, m) = h[k + 2];
    }
  }
  const Eigen::BDCSVD<MatrixXd> svd(hankel, Eigen::ComputeThinU | Eigen::ComputeThinV);
  const VectorXd& s = svd.singularValues();
  const double noise = rounding * torque / small * std::sqrt(static_cast<double>(blocks * m));
  const double least = std::max(noise, 1e-11 * (s[0] + largest(h[0])));
  const Index r = (s.array() > least).count();
  const VectorXd root = s.head(r).cwiseSqrt(), inverse = root.cwiseInverse();
  const MatrixXd observed = svd.matrixU().leftCols(r), reached = svd.matrixV().leftCols(r);
  return in_pulses(
      {inverse.asDiagonal() * (observed.transpose() * shifted * reached) * inverse.asDiagonal(),
       root.asDiagonal() * reached.topRows(m).transpose(),
       observed.topRows(n) * root.asDiagonal(),
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

/// The largest difference as a part of each joint's answers, of all and of the end of the step: a
/// filter's answer to a pulse is thousands of times that to a step. @param noise of rounding
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

LinearLaw realised(const Ask& ask, Index inputs, Index window, Index ticks) {
  double torque = 0;
  const LinearLaw law = model_of(pulse_answers(ask, inputs, window, torque), torque);
  const MatrixXd given = probe(inputs, ticks);
  const MatrixXd at_rest = ask(0 * given);
  const auto answer = [&](const MatrixXd& deviations) -> MatrixXd {
    return ask(deviations) - at_rest;
  };
  const MatrixXd once = answer(factor * given);
  const double noise = rounding * (largest(at_rest) + largest(once));
  if (disagreement(once, factor * foretell(law, given), noise) < agreement) return law;

  const auto refuse_unless = [&](const char* what, const MatrixXd& is, const MatrixXd& expected) {
    const double by = disagreement(is, expected, 2 * static_cast<double>(inputs) * noise);
    if (by < agreement) return;
    throw NoLinearModel(fmt::format(
        "its answers do not superpose: {}, by {:.2g} of it; a limit, dead band or sign in it?",
        what, by));
  };
  refuse_unless("that to deviations of 1e-05 is not 10 times that to 1e-06", once,
                factor * answer(given));
  refuse_unless("that to -1e-05 is not the opposite of that to 1e-05", answer(-factor * given),
                -once);
  MatrixXd sum = 0 * once;
  for (Index j = 0; j < inputs; ++j) {
    MatrixXd alone = 0 * given;
    alone.row(j) = factor * given.row(j);
    sum += answer(alone);
  }
  refuse_unless("that to all inputs is not the sum of those to each", once, sum);
  throw NoLinearModel(
      fmt::format("a model of {} ticks of its answers does not foretell {}: its memory is longer, "
                  "or it depends on the time",
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
  throw std::logic_error("certificate::windows is empty");
}

}  // namespace tachless::certificate

#include "identify/friction_terms.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "numerics/decompositions.h"

namespace tachless::identify {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Velocities v_r that are tried: shares of the joint's largest speed from `first_share` to 1, each
/// `finer` times the one before. A faster turn is a sign behind the filter.
constexpr double first_share = 0.02, finer = 1.3;
constexpr double least_gain = 0.02;      ///< of the error in blocks that were not fitted
constexpr Index validation_blocks = 10;  ///< of time

/// One joint's rows in all recordings, with a column per parameter of this joint.
struct JointProblem {
  std::vector<FrictionTerm> terms;  ///< candidates
  MatrixXd own, candidates;
  VectorXd torque;  ///< that the answer leaves

  [[nodiscard]] MatrixXd with(const std::vector<Index>& chosen) const {
    MatrixXd J(own.rows(), own.cols() + std::ssize(chosen));
    J << own, MatrixXd(candidates(Eigen::all, chosen));
    return J;
  }
  /// Returns the rms torque of blocks of time that each fit leaves out.
  [[nodiscard]] double validation_error(const std::vector<Index>& chosen) const {
    MatrixXd J = with(chosen);
    J *= J.colwise().norm().cwiseMax(1e-300).cwiseInverse().asDiagonal();
    const MatrixXd N = J.transpose() * J + 1e-12 * MatrixXd::Identity(J.cols(), J.cols());
    const VectorXd b = J.transpose() * torque;
    double sum = 0;
    for (Index block = 0; block < validation_blocks; ++block) {
      const Index from = block * J.rows() / validation_blocks,
                  rows = (block + 1) * J.rows() / validation_blocks - from;
      const auto out = J.middleRows(from, rows);
      const auto left_out = torque.segment(from, rows);
      const MatrixXd other = N - out.transpose() * out;
      const VectorXd x = numerics::inverse(other) * (b - out.transpose() * left_out);
      sum += (left_out - out * x).squaredNorm();
    }
    return std::sqrt(sum / static_cast<double>(J.rows()));
  }
};

/// Returns the velocities that are tried at a joint.
std::vector<FrictionTerm> candidates_at(int joint, const std::vector<Regression>& regressions) {
  double fastest = 0;
  for (const Regression& each : regressions) {
    for (Index row = joint; row < each.speed.size(); row += each.peak.size()) {
      fastest = std::max(fastest, std::abs(each.speed[row]));
    }
  }
  std::vector<FrictionTerm> result = {{Kind::load_friction, joint}};
  for (double share = first_share; share < 1.001; share *= finer) {
    result.push_back({Kind::rise, joint, share * fastest});
  }
  return result;
}

JointProblem problem_at(int joint, const std::vector<Recording>& recordings,
                        const std::vector<Kind>& kinds, const std::vector<Regression>& regressions,
                        const VectorXd& values) {
  JointProblem result{candidates_at(joint, regressions), {}, {}, {}};
  std::vector<Kind> own_kinds;
  for (const Kind kind : {Kind::rotor, Kind::viscous, Kind::coulomb, Kind::offset}) {
    if (std::ranges::find(kinds, kind) != kinds.end()) own_kinds.push_back(kind);
  }
  const scenario::Scenario& scenario = recordings.front().scenario;
  const Parameters all(scenario, own_kinds, false, result.terms);
  std::vector<Index> own, more;
  for (Index i = 0; i < all.size(); ++i) {
    const Parameters::Entry& entry = all.entries()[static_cast<std::size_t>(i)];
    if (entry.joint != joint) continue;
    const bool term = entry.kind == Kind::rise || entry.kind == Kind::load_friction;
    (term ? more : own).push_back(i);
  }
  Index rows = 0, from = 0;
  for (const Regression& each : regressions) rows += each.torque.size() / each.peak.size();
  result.own.resize(rows, std::ssize(own));
  result.candidates.resize(rows, std::ssize(more));
  result.torque.resize(rows);
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    const Regression here = regression(recordings[r], all);
    const VectorXd left = regressions[r].torque - regressions[r].columns * values;
    for (Index row = joint; row < left.size(); row += here.peak.size(), ++from) {
      result.own.row(from) = here.columns.row(row)(own);
      result.candidates.row(from) = here.columns.row(row)(more);
      result.torque[from] = left[row];
    }
  }
  return result;
}

/// Returns whether the last chosen term is told from zero and takes energy with the others.
bool is_possible(const JointProblem& problem, const std::vector<Index>& chosen, Index own_coulomb,
                 double coulomb) {
  const MatrixXd J = problem.with(chosen);
  const VectorXd norm = J.colwise().norm().transpose().cwiseMax(1e-300);
  const MatrixXd scaled = J * norm.cwiseInverse().asDiagonal();
  const VectorXd x =
      (numerics::inverse(scaled.transpose() * scaled) * (scaled.transpose() * problem.torque))
          .cwiseQuotient(norm);
  const Precision found = precision(J, norm, problem.torque - J * x);
  const Index last = x.size() - 1;
  if (!(found.half_width[last] < std::abs(x[last]))) return false;
  const bool loads =
      problem.terms[static_cast<std::size_t>(chosen.back())].kind == Kind::load_friction;
  return loads ? x[last] > 0 : coulomb + x[own_coulomb] + std::min(0.0, x[last]) >= 0;
}

/// Returns the velocity at the least error, by a parabola through three errors over log v.
double refined_velocity(const JointProblem& problem, std::vector<Index> chosen) {
  const Index at = chosen.back();
  const double here = problem.terms[static_cast<std::size_t>(at)].velocity;
  if (at <= 1 || at + 1 >= std::ssize(problem.terms)) return here;
  const double middle = problem.validation_error(chosen);
  chosen.back() = at - 1;
  const double below = problem.validation_error(chosen);
  chosen.back() = at + 1;
  const double above = problem.validation_error(chosen), bend = below - 2 * middle + above;
  return bend > 0 ? here * std::pow(finer, std::clamp(0.5 * (below - above) / bend, -0.5, 0.5))
                  : here;
}

}  // namespace

std::vector<FrictionTerm> friction_terms(const std::vector<Recording>& recordings,
                                         const std::vector<Kind>& kinds,
                                         const std::vector<Regression>& regressions,
                                         const Parameters& parameters, const VectorXd& values,
                                         const std::vector<Misfit>& misfits) {
  std::vector<FrictionTerm> result;
  const Index coulomb = parameters.first(Kind::coulomb);
  for (std::size_t j = 0; j < misfits.size(); ++j) {
    if (!is_misfit(misfits[j])) continue;
    const auto joint = static_cast<int>(j);
    const JointProblem problem = problem_at(joint, recordings, kinds, regressions, values);
    const Index own_coulomb = std::ranges::find(kinds, Kind::rotor) == kinds.end() ? 1 : 2;
    std::vector<Index> chosen;
    double error = problem.validation_error(chosen);
    for (std::optional<Kind> before; std::ssize(chosen) < 2;) {
      Index best = -1;
      double least = (1 - least_gain) * error;
      for (Index c = 0; c < std::ssize(problem.terms); ++c) {
        if (problem.terms[static_cast<std::size_t>(c)].kind == before) continue;
        std::vector<Index> next = chosen;
        next.push_back(c);
        const double with = problem.validation_error(next);
        if (with < least && is_possible(problem, next, own_coulomb, values[coulomb + joint])) {
          least = with;
          best = c;
        }
      }
      if (best < 0) break;
      chosen.push_back(best);
      error = least;
      FrictionTerm term = problem.terms[static_cast<std::size_t>(best)];
      before = term.kind;
      if (term.kind == Kind::rise) term.velocity = refined_velocity(problem, chosen);
      result.push_back(term);
    }
  }
  return result;
}

std::vector<FrictionTerm> kept_terms(const std::vector<FrictionTerm>& terms,
                                     const Parameters& parameters, const LeastSquares& found) {
  std::vector<FrictionTerm> result;
  const Index coulomb = parameters.first(Kind::coulomb),
              first = found.values.size() - std::ssize(terms);
  for (std::size_t t = 0; t < terms.size(); ++t) {
    const Index i = first + static_cast<Index>(t);
    const double value = found.values[i];
    if (!(found.half_width[i] < std::abs(value))) continue;
    if (terms[t].kind == Kind::rise && found.values[coulomb + terms[t].joint] + value < 0) continue;
    result.push_back(terms[t]);
  }
  return result;
}

}  // namespace tachless::identify

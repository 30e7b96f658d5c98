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
/// Least gain of a term, as a share of the error in blocks that were not fitted, and of the joint's
/// peak torque. A right model leaves errors of the filter, which a term lowers too, but by less.
constexpr double least_gain = 0.03, least_part = 0.002;
constexpr double clear_widths = 1.5;     ///< half widths by which a term is told from zero
constexpr Index validation_blocks = 10;  ///< of time
constexpr Index least_rows = 300;        ///< of motion one way

/// Least gain of a rise in all rows, as a share of the error. Rows near reversals have errors of
/// the filter, which a rise at low speed lowers.
constexpr double least_gain_at_reversals = 0.1;

/// One joint's rows in all recordings.
struct JointProblem {
  std::vector<FrictionTerm> terms;  ///< candidates
  MatrixXd own, candidates;         ///< columns: the joint's and the delay's, and the candidates'
  VectorXd torque;                  ///< that the answer leaves
  std::vector<Index> one_way;       ///< rows that are not near a reversal
  Index coulomb = 0;                ///< the number of the joint's own column of Coulomb friction
  double peak = 0;

  /// Returns the problem of the rows of motion one way.
  [[nodiscard]] JointProblem of_one_way() const {
    return {terms,
            own(one_way, Eigen::all),
            candidates(one_way, Eigen::all),
            torque(one_way),
            {},
            coulomb,
            peak};
  }
  [[nodiscard]] MatrixXd with(const std::vector<Index>& chosen) const {
    MatrixXd J(own.rows(), own.cols() + std::ssize(chosen));
    J << own, MatrixXd(candidates(Eigen::all, chosen));
    return J;
  }
  /// Returns the rms torque in blocks of time that each fit leaves out.
  [[nodiscard]] double validation_error(const std::vector<Index>& chosen) const {
    MatrixXd J = with(chosen);
    const VectorXd scale = J.colwise().norm().transpose().cwiseMax(1e-300).cwiseInverse();
    J *= scale.asDiagonal();
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

/// Returns the terms that are tried at a joint.
std::vector<FrictionTerm> candidates_at(int joint, const std::vector<Regression>& regressions) {
  const double fastest = largest_speed(regressions, joint);
  std::vector<FrictionTerm> result = {{Kind::load_friction, joint}};
  if (fastest == 0) return result;
  for (double share = first_share; share < 1.001; share *= finer) {
    result.push_back({Kind::rise, joint, share * fastest});
  }
  return result;
}

JointProblem problem_at(int joint, const std::vector<Recording>& recordings,
                        const std::vector<Regression>& regressions, const Parameters& parameters,
                        const VectorXd& values) {
  JointProblem result{candidates_at(joint, regressions), {}, {}, {}, {}};
  std::vector<Index> own;
  for (Index i = 0; i < parameters.size(); ++i) {
    const Parameters::Entry& entry = parameters.entries()[static_cast<std::size_t>(i)];
    const bool of_joint = entry.joint == joint && entry.kind != Kind::inertia;
    if (!of_joint && entry.kind != Kind::delay) continue;
    if (entry.kind == Kind::coulomb) result.coulomb = std::ssize(own);
    own.push_back(i);
  }
  const Parameters more(recordings.front().scenario, {}, recordings.front().controlled,
                        result.terms);
  Index rows = 0, at = 0;
  for (const Regression& each : regressions) rows += each.torque.size() / each.peak.size();
  result.own.resize(rows, std::ssize(own));
  result.candidates.resize(rows, more.size());
  result.torque.resize(rows);
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    const Regression& here = regressions[r];
    const MatrixXd columns = regression(recordings[r], more).columns;
    const VectorXd left = here.torque - here.columns * values;
    result.peak = std::max(result.peak, here.peak[joint]);
    for (Index row = joint; row < left.size(); row += here.peak.size()) {
      if (!here.reversing[static_cast<std::size_t>(row)]) result.one_way.push_back(at);
      result.own.row(at) = here.columns.row(row)(own);
      result.candidates.row(at) = columns.row(row);
      result.torque[at++] = left[row];
    }
  }
  return result;
}

/// Returns whether the last chosen term is told from zero and takes energy with the others.
/// @param coulomb the joint's Coulomb friction in the answer
bool is_possible(const JointProblem& problem, const std::vector<Index>& chosen, double coulomb) {
  const Fitted found = fitted(problem.with(chosen), problem.torque);
  const VectorXd& x = found.values;
  const Index last = x.size() - 1;
  if (!(clear_widths * found.half_width[last] < std::abs(x[last]))) return false;
  const bool loads =
      problem.terms[static_cast<std::size_t>(chosen.back())].kind == Kind::load_friction;
  return loads ? x[last] > 0 && x[last] <= 1
               : coulomb + x[problem.coulomb] + std::min(0.0, x[last]) >= 0;
}

/// Returns the velocity at the least error, by a parabola through three errors over log v.
/// @param i number of the rise among the chosen
double refined_velocity(const JointProblem& problem, std::vector<Index> chosen, std::size_t i) {
  const Index at = chosen[i];
  const double here = problem.terms[static_cast<std::size_t>(at)].velocity;
  if (at <= 1 || at + 1 >= std::ssize(problem.terms)) return here;
  const double middle = problem.validation_error(chosen);
  chosen[i] = at - 1;
  const double below = problem.validation_error(chosen);
  chosen[i] = at + 1;
  const double above = problem.validation_error(chosen), bend = below - 2 * middle + above;
  return bend > 0 ? here * std::pow(finer, std::clamp(0.5 * (below - above) / bend, -0.5, 0.5))
                  : here;
}

/// A choice of candidates, and its error in blocks that were not fitted.
struct Choice {
  std::vector<Index> candidates;
  double error;
};

/// Returns the choice with one candidate more that has the least error, or nothing if none is below
/// `most`.
/// @param kind of the candidates
std::optional<Choice> with_one_more(const JointProblem& problem, const std::vector<Index>& chosen,
                                    Kind kind, double most, double coulomb) {
  std::optional<Choice> best;
  for (Index c = 0; c < std::ssize(problem.terms); ++c) {
    if (problem.terms[static_cast<std::size_t>(c)].kind != kind) continue;
    std::vector<Index> next = chosen;
    next.push_back(c);
    const double error = problem.validation_error(next);
    if (error >= (best ? best->error : most) || !is_possible(problem, next, coulomb)) continue;
    best = {std::move(next), error};
  }
  return best;
}

/// Returns the largest error that a further term must have.
double enough(const JointProblem& problem, double error, double gain) {
  const double rest = error * error - std::pow(least_part * problem.peak, 2);
  return std::min((1 - gain) * error, std::sqrt(std::max(0.0, rest)));
}

/// Returns the terms of one joint.
std::vector<FrictionTerm> terms_of(const JointProblem& all, double coulomb) {
  if (std::ssize(all.one_way) < least_rows) return {};
  const JointProblem one_way = all.of_one_way();
  // A factor of gravity's torque is at most 1.
  const bool bears =
      one_way.candidates.col(0).norm() >
      least_part * one_way.peak * std::sqrt(static_cast<double>(one_way.torque.size()));
  Choice chosen{{}, one_way.validation_error({})};
  std::vector<Kind> kinds = {Kind::rise};
  if (bears) kinds.push_back(Kind::load_friction);
  while (!kinds.empty()) {
    std::optional<Choice> best;
    for (const Kind kind : kinds) {
      const double most = best ? best->error : enough(one_way, chosen.error, least_gain);
      if (auto with = with_one_more(one_way, chosen.candidates, kind, most, coulomb)) best = with;
    }
    if (!best) break;
    chosen = *best;
    std::erase(kinds, one_way.terms[static_cast<std::size_t>(chosen.candidates.back())].kind);
  }
  std::vector<FrictionTerm> result;
  std::vector<Index> loads;
  for (std::size_t i = 0; i < chosen.candidates.size(); ++i) {
    const Index c = chosen.candidates[i];
    FrictionTerm term = one_way.terms[static_cast<std::size_t>(c)];
    if (term.kind == Kind::load_friction) loads.push_back(c);
    if (term.kind == Kind::rise) term.velocity = refined_velocity(one_way, chosen.candidates, i);
    result.push_back(term);
  }
  // Friction that turns round slowly at reversals.
  const double most = enough(all, all.validation_error(chosen.candidates), least_gain_at_reversals);
  if (const auto found = with_one_more(all, loads, Kind::rise, most, coulomb)) {
    std::erase_if(result, [](const FrictionTerm& each) { return each.kind == Kind::rise; });
    FrictionTerm term = all.terms[static_cast<std::size_t>(found->candidates.back())];
    term.velocity = refined_velocity(all, found->candidates, found->candidates.size() - 1);
    term.at_reversals = true;
    result.push_back(term);
  }
  return result;
}

}  // namespace

bool takes_energy(Kind kind, double value, double coulomb) {
  return kind == Kind::load_friction ? value > 0 && value <= 1 && coulomb > 0
                                     : coulomb + std::min(0.0, value) >= 0;
}

double largest_speed(const std::vector<Regression>& regressions, int joint) {
  double largest = 0;
  for (const Regression& each : regressions) {
    for (Index row = joint; row < each.speed.size(); row += each.peak.size()) {
      largest = std::max(largest, std::abs(each.speed[row]));
    }
  }
  return largest;
}

std::vector<FrictionTerm> friction_terms(const std::vector<Recording>& recordings,
                                         const std::vector<Regression>& regressions,
                                         const Parameters& parameters, const VectorXd& values) {
  const Index coulomb = parameters.first(Kind::coulomb);
  std::vector<FrictionTerm> result;
  for (Index j = 0; j < regressions.front().peak.size(); ++j) {
    const JointProblem problem =
        problem_at(static_cast<int>(j), recordings, regressions, parameters, values);
    for (const FrictionTerm& each : terms_of(problem, values[coulomb + j])) result.push_back(each);
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
    if (!(clear_widths * found.half_width[i] < std::abs(value))) continue;
    if (takes_energy(terms[t].kind, value, found.values[coulomb + terms[t].joint])) {
      result.push_back(terms[t]);
    }
  }
  return result;
}

}  // namespace tachless::identify

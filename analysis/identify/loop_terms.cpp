#include "identify/loop_terms.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "base/parallel.h"
#include "numerics/decompositions.h"

namespace tachless::identify {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr Index left_out_blocks = 10;  ///< of time
/// Shares of a joint's largest speed that are tried as v_r. The fit moves v_r afterwards.
constexpr double slowest_turn = 0.02, next_turn = 1.7;
/// Size of a simulated candidate, over the joint's friction in the answer. Its share of the joint's
/// largest torque if that is more.
constexpr double of_friction = 0.1, of_torque = 1e-3;
/// Least effect of the largest load friction that is possible, as a share of the error.
constexpr double least_effect = 0.1;

/// A term that is simulated, and its column's step.
struct SimulatedTerm {
  FrictionTerm term;
  double step;
};

/// Normal equations of blocks of time. Columns are scaled to norm 1.
class Blocks {
 public:
  Blocks(const MatrixXd& J, const VectorXd& y)
      : unit_(J.colwise().norm().transpose().cwiseMax(1e-300).cwiseInverse()) {
    for (Index block = 0; block < left_out_blocks; ++block) {
      const Index from = block * J.rows() / left_out_blocks,
                  rows = (block + 1) * J.rows() / left_out_blocks - from;
      const MatrixXd part = J.middleRows(from, rows) * unit_.asDiagonal();
      normal_.emplace_back(part.transpose() * part);
      slope_.emplace_back(part.transpose() * y.segment(from, rows));
      square_.push_back(y.segment(from, rows).squaredNorm());
    }
  }

  /// Returns the solution without a block, of some columns.
  /// @param block to leave out; -1: none
  [[nodiscard]] VectorXd solution(const std::vector<Index>& columns, Index block) const {
    return scaled(columns, block).cwiseProduct(unit_(columns));
  }

  /// Returns the sum of squares in blocks that each fit leaves out.
  [[nodiscard]] double held_out(const std::vector<Index>& columns) const {
    double sum = 0;
    for (Index block = 0; block < left_out_blocks; ++block) {
      const auto at = static_cast<std::size_t>(block);
      const VectorXd x = scaled(columns, block);
      sum += square_[at] + x.dot(normal_[at](columns, columns) * x - 2 * slope_[at](columns));
    }
    return sum;
  }

 private:
  [[nodiscard]] VectorXd scaled(const std::vector<Index>& columns, Index block) const {
    const Index size = std::ssize(columns);
    MatrixXd N = 1e-9 * MatrixXd::Identity(size, size);
    VectorXd b = VectorXd::Zero(size);
    for (Index each = 0; each < left_out_blocks; ++each) {
      if (each == block) continue;
      N += normal_[static_cast<std::size_t>(each)](columns, columns);
      b += slope_[static_cast<std::size_t>(each)](columns);
    }
    return numerics::inverse(N) * b;
  }

  VectorXd unit_;
  std::vector<MatrixXd> normal_;
  std::vector<VectorXd> slope_;
  std::vector<double> square_;
};

/// Returns the numbers from 0 to size - 1.
std::vector<Index> numbers(Index size) {
  std::vector<Index> result;
  for (Index i = 0; i < size; ++i) result.push_back(i);
  return result;
}

/// The linear problem at the answer, with columns of terms behind those of the fit.
struct LoopProblem {
  const Fit& fit;
  Parameters parameters;  ///< of the fit
  std::vector<SimulatedTerm> candidates;
  Blocks blocks;

  /// Returns the new terms, which are the last columns; nothing if a friction would give energy.
  [[nodiscard]] std::optional<LoopTerms> found(const std::vector<Index>& columns) const {
    const Index size = parameters.size(), first = fit.J.cols(), more = std::ssize(columns) - first;
    const VectorXd change = blocks.solution(columns, -1);
    LoopTerms result{{}, VectorXd(size + more)};
    result.start << fit.values, change.tail(more);
    for (Index i = 0; i < size; ++i) {
      const Parameters::Entry& entry = parameters.entries()[static_cast<std::size_t>(i)];
      if (entry.kind == Kind::inertia || entry.kind == Kind::load) continue;
      const double value = fit.values[i] + change[i];
      result.start[i] = entry.not_negative ? std::max(0.0, value) : value;
    }
    for (Index i = 0; i < more; ++i) {
      const Index c = columns[static_cast<std::size_t>(first + i)] - first;
      const FrictionTerm& term = candidates[static_cast<std::size_t>(c)].term;
      const double coulomb = result.start[parameters.first(Kind::coulomb) + term.joint];
      if (!takes_energy(term.kind, change[first + i], coulomb)) return {};
      result.terms.push_back(term);
    }
    return result;
  }
};

bool has(const std::vector<FrictionTerm>& terms, Kind kind, int joint) {
  return std::ranges::any_of(
      terms, [&](const FrictionTerm& each) { return each.kind == kind && each.joint == joint; });
}

/// Returns the terms that are simulated at a joint.
/// @param known friction of the scenario, which stays if it has a term
std::vector<SimulatedTerm> simulated_at(int joint, const std::vector<Regression>& regressions,
                                        const Parameters& parameters, const VectorXd& values,
                                        const std::vector<FrictionTerm>& terms,
                                        const plant::DriveSpec& known) {
  const double fastest = largest_speed(regressions, joint);
  const double coulomb = values[parameters.first(Kind::coulomb) + joint];
  const double friction = coulomb + fastest * values[parameters.first(Kind::viscous) + joint];
  double peak = 0;
  for (const Regression& each : regressions) peak = std::max(peak, each.peak[joint]);
  const double torque = std::max(of_friction * friction, of_torque * peak);
  std::vector<SimulatedTerm> result;
  const bool has_load = has(terms, Kind::load_friction, joint) || known.load_friction[joint] != 0;
  // Friction that grows with the load is on top of Coulomb friction.
  if (!has_load && coulomb > 0 && peak > 0) {
    result.push_back({{Kind::load_friction, joint, 1, true}, torque / peak});
  }
  const bool has_rise = has(terms, Kind::rise, joint) || known.friction_rise_Nm[joint] != 0;
  if (has_rise || fastest == 0) return result;
  for (double share = slowest_turn; share < 1; share *= next_turn) {
    result.push_back({{Kind::rise, joint, share * fastest, true}, torque});
  }
  return result;
}

LoopProblem problem_of(const std::vector<Recording>& recordings,
                       const std::vector<Regression>& regressions, const Fit& fit,
                       const std::vector<Kind>& kinds, const std::vector<FrictionTerm>& terms,
                       const std::vector<int>& joints) {
  const scenario::Scenario& scenario = recordings.front().scenario;
  const Parameters parameters(scenario, kinds, true, terms);
  std::vector<SimulatedTerm> candidates;
  for (const int joint : joints) {
    const auto more =
        simulated_at(joint, regressions, parameters, fit.values, terms, scenario.plant.drive);
    candidates.insert(candidates.end(), more.begin(), more.end());
  }
  const Index own = fit.J.cols();
  MatrixXd J(fit.J.rows(), own + std::ssize(candidates));
  J.leftCols(own) = fit.J;
  base::parallel_for(candidates.size(), [&](std::size_t c) {
    std::vector<FrictionTerm> with = terms;
    with.push_back(candidates[c].term);
    VectorXd values(fit.values.size() + 1);
    values << fit.values, candidates[c].step;
    const VectorXd there =
        rows_of_fit(recordings, Parameters(scenario, kinds, true, with), values, fit);
    J.col(own + static_cast<Index>(c)) = (there - fit.r) / candidates[c].step;
  });
  for (std::size_t c = 0; c < candidates.size(); ++c) {
    auto column = J.col(own + static_cast<Index>(c));
    const bool loads = candidates[c].term.kind == Kind::load_friction;
    if (loads && column.norm() < least_effect * fit.r.norm()) column.setZero();
  }
  return {fit, parameters, std::move(candidates), Blocks(J, -fit.r)};
}

}  // namespace

LoopTerms loop_terms(const std::vector<Recording>& recordings,
                     const std::vector<Regression>& regressions, const Fit& fit,
                     const std::vector<Kind>& kinds, const std::vector<FrictionTerm>& terms,
                     const std::vector<int>& joints) {
  const LoopProblem problem = problem_of(recordings, regressions, fit, kinds, terms, joints);
  std::vector<Index> columns = numbers(fit.J.cols());
  LoopTerms result;
  double error = problem.blocks.held_out(columns);
  const double gain = (1 - std::pow(1 - least_loop_gain, 2)) * static_cast<double>(fit.r.size()) /
                      static_cast<double>(fit.residual.size());
  while (true) {
    double least = error - gain;
    std::optional<Index> best;
    for (Index c = 0; c < std::ssize(problem.candidates); ++c) {
      const FrictionTerm& term = problem.candidates[static_cast<std::size_t>(c)].term;
      if (has(result.terms, term.kind, term.joint)) continue;
      columns.push_back(fit.J.cols() + c);
      const double with = problem.blocks.held_out(columns);
      if (with < least && problem.found(columns)) {
        least = with;
        best = c;
      }
      columns.pop_back();
    }
    if (!best) return result;
    error = least;
    columns.push_back(fit.J.cols() + *best);
    result = *problem.found(columns);
  }
}

VectorXd held_out_error(const Fit& fit) {
  const Blocks blocks(fit.J, -fit.r);
  const std::vector<Index> columns = numbers(fit.J.cols());
  const Index joints = fit.residual.size();
  VectorXd sum = VectorXd::Zero(joints);
  for (Index block = 0; block < left_out_blocks; ++block) {
    const VectorXd x = blocks.solution(columns, block);
    const Index from = block * fit.J.rows() / left_out_blocks,
                to = (block + 1) * fit.J.rows() / left_out_blocks;
    const VectorXd left = fit.r.segment(from, to - from) + fit.J.middleRows(from, to - from) * x;
    for (Index row = from; row < to; ++row) sum[row % joints] += std::pow(left[row - from], 2);
  }
  return fit.residual.cwiseProduct(
      (sum * static_cast<double>(joints) / static_cast<double>(fit.r.size())).cwiseSqrt());
}

}  // namespace tachless::identify

#include "identify/misfit.h"

#include <algorithm>
#include <cmath>

#include "scenario/scenario.h"

namespace tachless::identify {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double lag_s = 0.05;  ///< three times the filter's time constant
/// Between the largest correlation of right arms (0.2 in tables, 0.4 in logs) and the least one of
/// wrong models (0.43 and 0.9).
constexpr double torque_correlation = 0.35, position_correlation = 0.6;
constexpr double least_torque = 0.002;   ///< share of the peak
constexpr double least_position = 1e-6;  ///< share of the joint's motion
constexpr double noise_margin = 1.2;     ///< factor on the encoder's rms error
constexpr Index least_pairs = 100;       ///< that a correlation needs
constexpr double slow_motion = 0.2;      ///< for the test of friction, share of the largest speed
constexpr Index least_slow = 30;         ///< rows
/// Least difference of friction: in half widths of its 95 % interval, and as a share of the peak.
constexpr double least_widths = 3, least_friction = 0.01;

/// The rows of one joint in one recording, in order of time.
struct JointRows {
  VectorXd residual, speed;
  std::vector<bool> slow, reversing;
  double step_s = 1, peak = 0;

  JointRows(const Regression& regression, const VectorXd& left, Index joint)
      : peak(regression.peak[joint]) {
    const Index n = regression.peak.size(), instants = regression.torque.size() / n;
    residual.resize(instants);
    speed.resize(instants);
    for (Index k = 0; k < instants; ++k) {
      const Index row = k * n + joint;
      residual[k] = left[row];
      speed[k] = regression.speed[row];
      slow.push_back(regression.slow[static_cast<std::size_t>(row)]);
      reversing.push_back(regression.reversing[static_cast<std::size_t>(row)]);
    }
    if (instants > 1) step_s = regression.time_s[n] - regression.time_s[0];
  }
};

Misfit of_torques(const JointRows& rows) {
  const auto lag = std::max<Index>(1, std::lround(lag_s / rows.step_s));
  double product = 0, first = 0, second = 0;
  Index pairs = 0;
  for (Index k = 0; k + lag < rows.residual.size(); ++k) {
    const double a = rows.residual[k], b = rows.residual[k + lag];
    if (rows.slow[static_cast<std::size_t>(k)] || rows.slow[static_cast<std::size_t>(k + lag)]) {
      continue;
    }
    product += a * b;
    first += a * a;
    second += b * b;
    ++pairs;
  }
  Misfit result;
  result.tested = pairs >= least_pairs;
  if (!result.tested || first <= 0 || second <= 0) return result;
  result.correlation = product / std::sqrt(first * second);
  result.found = result.correlation > torque_correlation &&
                 std::sqrt(first / static_cast<double>(pairs)) > least_torque * rows.peak;
  return result;
}

/// Returns the Coulomb friction that slow motion has beyond fast motion, or 0 if the data do not
/// tell it from zero.
double slow_friction(const JointRows& rows) {
  const double largest = rows.speed.cwiseAbs().maxCoeff();
  std::vector<Index> used;
  Index slow = 0;
  for (Index k = 0; k < rows.speed.size(); ++k) {
    if (rows.reversing[static_cast<std::size_t>(k)]) continue;
    used.push_back(k);
    slow += std::abs(rows.speed[k]) < slow_motion * largest ? 1 : 0;
  }
  if (slow < least_slow || std::ssize(used) - slow < least_slow) return 0;
  MatrixXd J(std::ssize(used), 3);
  const VectorXd v = rows.speed(used), sign = v.cwiseSign();
  J << v, sign, (v.array().abs() < slow_motion * largest).select(sign, 0);
  const Fitted found = fitted(J, rows.residual(used));
  const double least = std::max(least_widths * found.half_width[2], least_friction * rows.peak);
  return std::abs(found.values[2]) > least ? found.values[2] : 0;
}

}  // namespace

std::vector<Misfit> worse(std::vector<Misfit> one, const std::vector<Misfit>& other) {
  if (one.empty()) return other;
  for (std::size_t i = 0; i < one.size(); ++i) {
    one[i].correlation = std::max(one[i].correlation, other[i].correlation);
    one[i].found = one[i].found || other[i].found;
    one[i].tested = one[i].tested || other[i].tested;
    if (std::abs(other[i].slow_friction) > std::abs(one[i].slow_friction)) {
      one[i].slow_friction = other[i].slow_friction;
    }
  }
  return one;
}

std::vector<Misfit> torque_misfits(const std::vector<Regression>& regressions,
                                   const Parameters& parameters, const VectorXd& values) {
  const bool friction =
      parameters.first(Kind::viscous) >= 0 && parameters.first(Kind::coulomb) >= 0;
  std::vector<Misfit> result;
  for (const Regression& each : regressions) {
    const VectorXd left = each.torque - each.columns * values;
    std::vector<Misfit> here;
    for (Index j = 0; j < each.peak.size(); ++j) {
      const JointRows rows(each, left, j);
      here.push_back(of_torques(rows));
      if (friction) here.back().slow_friction = slow_friction(rows);
    }
    result = worse(std::move(result), here);
  }
  return result;
}

std::vector<Misfit> position_misfits(const Recording& recording, const MatrixXd& residual) {
  const scenario::Scenario& scenario = recording.scenario;
  const Vector count = scenario::encoder_count(scenario, *scenario.model);
  const double noise = scenario.plant.encoder.noise_std_rad;
  std::vector<Misfit> result(static_cast<std::size_t>(residual.cols()));
  for (Index j = 0; j < residual.cols(); ++j) {
    const VectorXd r = residual.col(j);
    const Index last = r.size() - 1;
    Misfit& misfit = result[static_cast<std::size_t>(j)];
    misfit.correlation = r.head(last).dot(r.tail(last)) / std::max(1e-300, r.squaredNorm());
    const double rms = r.norm() / std::sqrt(static_cast<double>(r.size()));
    const double motion = recording.q.col(j).maxCoeff() - recording.q.col(j).minCoeff();
    misfit.found = misfit.correlation > position_correlation &&
                   rms > noise_margin * std::hypot(count[j] / std::sqrt(12.0), noise) &&
                   rms > least_position * motion;
  }
  return result;
}

std::vector<RowUse> rows_of(const Parameters& parameters, Index joints) {
  std::vector<RowUse> rows(static_cast<std::size_t>(joints), RowUse::fast);
  for (const Parameters::Entry& entry : parameters.entries()) {
    if (!is_term(entry.kind)) continue;
    RowUse& of_joint = rows[static_cast<std::size_t>(entry.joint)];
    if (of_joint != RowUse::all) of_joint = entry.at_reversals ? RowUse::all : RowUse::one_way;
  }
  return rows;
}

TableAnswer table_answer(const std::vector<Regression>& regressions, const Parameters& parameters,
                         const robot::Model& model) {
  std::vector<RowUse> rows = rows_of(parameters, regressions.front().peak.size());
  TableAnswer result{least_squares(regressions, parameters, model, rows), {}};
  result.misfits = torque_misfits(regressions, parameters, result.values);
  const auto in_doubt = [](const Misfit& each) { return is_misfit(each) || !each.tested; };
  if (std::ranges::none_of(result.misfits, in_doubt)) return result;
  for (RowUse& each : rows) {
    if (each == RowUse::fast) each = RowUse::all;
  }
  const VectorXd before = result.values;
  static_cast<LeastSquares&>(result) = least_squares(regressions, parameters, model, rows);
  result.half_width += (result.values - before).cwiseAbs();
  return result;
}

}  // namespace tachless::identify

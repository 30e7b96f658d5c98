#include "identify/units.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "identify/least_squares.h"
#include "numerics/decompositions.h"
#include "robot/dynamics.h"

namespace tachless::identify {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Scales of positions: as they are, degrees, thousandths.
constexpr std::array<double, 3> position_scales = {1, std::numbers::pi / 180, 1e-3};
constexpr double edge_s = 0.3, row_s = 0.02;
/// Share of the variance by which another reading of the table must explain more.
constexpr double clearly = 0.15;
/// Factors between these are a wrong URDF's rather than a wrong unit's.
constexpr double least_factor = 0.4, most_factor = 2.5;
constexpr double sure = 10;  ///< standard deviations of white noise that a factor is from zero

/// How a torque depends on what the URDF predicts for a joint.
struct Dependence {
  double factor = 0, deviation = 0;  ///< of the URDF's torque
  double explained = 0;              ///< share of the variance
  double by_urdf = 0;                ///< share that only the URDF's torque explains
};

/// The motion of a table with positions in one unit.
class Motion {
 public:
  Motion(const Recording& table, double scale) {
    const double h = table.scenario.loop.period_s;
    const MatrixXd q = low_passed(scale * table.q, h);
    const Index ticks = q.rows(), n = q.cols();
    predicted_ = MatrixXd::Zero(ticks, n);
    v_ = a_ = predicted_;
    for (Index k = 1; k + 1 < ticks; ++k) {
      v_.row(k) = (q.row(k + 1) - q.row(k - 1)) / (2 * h);
      a_.row(k) = (q.row(k + 1) - 2 * q.row(k) + q.row(k - 1)) / (h * h);
      predicted_.row(k) =
          robot::inverse_dynamics<double>(*table.scenario.model, q.row(k).transpose(),
                                          v_.row(k).transpose(), a_.row(k).transpose())
              .transpose();
    }
    edge_ = static_cast<Index>(edge_s / h);
    step_ = std::max<Index>(1, std::lround(row_s / h));
  }

  [[nodiscard]] Dependence dependence_of(const VectorXd& torque, Index joint) const {
    const Index rows = (torque.size() - 2 * edge_) / step_;
    MatrixXd J(rows, 5);
    VectorXd tau(rows);
    for (Index i = 0; i < rows; ++i) {
      const Index k = edge_ + i * step_;
      const double v = v_(k, joint);
      J.row(i) << predicted_(k, joint), a_(k, joint), v, (v > 0 ? 1 : -1), 1;
      tau[i] = torque[k];
    }
    const VectorXd norm = J.colwise().norm().transpose().cwiseMax(1e-9);
    J = J * norm.cwiseInverse().asDiagonal();
    MatrixXd N = J.transpose() * J;
    N.diagonal().array() += 1e-9;  // a joint whose axis is vertical: prediction and acceleration
    const MatrixXd inverse = numerics::inverse(N);
    const VectorXd x = inverse * (J.transpose() * tau);
    const double left = (tau - J * x).squaredNorm(),
                 all = (tau.array() - tau.mean()).square().sum();
    return {x[0] / norm[0], std::sqrt(left / static_cast<double>(rows) * inverse(0, 0)) / norm[0],
            1 - left / std::max(1e-300, all), x[0] * x[0] / inverse(0, 0) / std::max(1e-300, all)};
  }

 private:
  MatrixXd predicted_, v_, a_;
  Index edge_ = 0, step_ = 1;
};

/// One reading of a table.
struct Reading {
  double scale = 1;
  std::vector<Index> order;  ///< torque column of each joint
  std::vector<Dependence> joints;

  /// Returns the share of the variance that the reading explains, in the mean of the joints.
  [[nodiscard]] double explained() const {
    double sum = 0;
    for (const Dependence& each : joints) sum += each.explained;
    return sum / static_cast<double>(joints.size());
  }
};

Reading reading_of(const Motion& motion, const MatrixXd& torques, double scale,
                   std::vector<Index> order) {
  Reading reading{scale, std::move(order), {}};
  for (Index j = 0; j < torques.cols(); ++j) {
    reading.joints.push_back(
        motion.dependence_of(torques.col(reading.order[static_cast<std::size_t>(j)]), j));
  }
  return reading;
}

std::vector<Index> own_order(Index n) {
  std::vector<Index> order;
  for (Index j = 0; j < n; ++j) order.push_back(j);
  return order;
}

/// Returns the order in which the torques are explained best, pair by pair.
std::vector<Index> best_order(const Motion& motion, const MatrixXd& torques) {
  const Index n = torques.cols();
  MatrixXd explained(n, n);
  for (Index j = 0; j < n; ++j) {
    for (Index k = 0; k < n; ++k)
      explained(j, k) = motion.dependence_of(torques.col(k), j).explained;
  }
  std::vector<Index> order(static_cast<std::size_t>(n));
  for (Index i = 0; i < n; ++i) {
    Index joint = 0, column = 0;
    explained.maxCoeff(&joint, &column);
    order[static_cast<std::size_t>(joint)] = column;
    explained.row(joint).setConstant(-1);
    explained.col(column).setConstant(-1);
  }
  return order;
}

/// Returns the scale that a torque needs: 1, -1, or a unit's or gear's factor.
double torque_scale(const Dependence& dependence, bool only_sign) {
  if (std::abs(dependence.factor) < sure * dependence.deviation) return 1;
  // Another URDF's links may turn the sign of a joint that gravity hardly loads.
  if (only_sign && dependence.by_urdf < clearly) return 1;
  const double sign = dependence.factor < 0 ? -1 : 1, size = std::abs(dependence.factor);
  if (only_sign || (size > least_factor && size < most_factor)) return sign;
  const double power = std::pow(10, std::round(std::log10(size)));
  // A torque of `factor` times the URDF's needs the reciprocal.
  return sign / (size > 0.7 * power && size < 1.4 * power ? power : size);
}

}  // namespace

std::string remedy_of(const Recording& table, const VectorXd& error) {
  const double h = table.scenario.loop.period_s;
  const MatrixXd torques = low_passed(table.tau, h);
  const Index n = torques.cols();
  const bool fits = error.maxCoeff() < no_fit;
  Reading best = reading_of(Motion(table, 1), torques, 1, own_order(n));
  for (const double scale : position_scales) {
    if (fits) break;
    const Motion motion(table, scale);
    for (const std::vector<Index>& order : {own_order(n), best_order(motion, torques)}) {
      Reading other = reading_of(motion, torques, scale, order);
      if (other.explained() > best.explained() + clearly) best = std::move(other);
    }
  }
  std::vector<std::string> keys;
  if (best.scale != 1) keys.push_back(fmt::format("position_scale: {:.6g}", best.scale));
  if (best.order != own_order(n)) {
    std::vector<Index> places;
    for (const Index each : best.order) places.push_back(each + 1);
    keys.push_back(fmt::format("torque_columns in the order [{}]", fmt::join(places, ", ")));
  }
  std::vector<double> scales;
  for (const Dependence& each : best.joints) scales.push_back(torque_scale(each, fits));
  if (std::ranges::any_of(scales, [&](double scale) { return fits ? scale < 0 : scale != 1; })) {
    keys.push_back(fmt::format("torque_scale: [{:.3g}]", fmt::join(scales, ", ")));
  }
  return fmt::format("{}", fmt::join(keys, ", "));
}

}  // namespace tachless::identify

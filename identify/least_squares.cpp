#include "identify/least_squares.h"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "robot/dynamics.h"

namespace tachless::identify {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double cutoff_hz = 15;
constexpr double settle_s = 0.3;  ///< left out at both ends: the filter's own transient

/// Butterworth's low-pass of second order, forwards and backwards: no phase.
void low_pass(Eigen::Ref<VectorXd> x, double h) {
  const double w = std::tan(std::numbers::pi * std::min(cutoff_hz * h, 0.2));
  const double scale = 1 / (1 + std::numbers::sqrt2 * w + w * w);
  const double b = w * w * scale, a1 = 2 * (w * w - 1) * scale,
               a2 = (1 - std::numbers::sqrt2 * w + w * w) * scale;
  for (int pass = 0; pass < 2; ++pass) {
    double x1 = x[0], x2 = x[0], y1 = x[0], y2 = x[0];
    for (double& value : x) {
      const double y = b * (value + 2 * x1 + x2) - a1 * y1 - a2 * y2;
      x2 = std::exchange(x1, value);
      y2 = std::exchange(y1, y);
      value = y;
    }
    x.reverseInPlace();
  }
}

MatrixXd filtered(MatrixXd x, double h) {
  for (Eigen::Index i = 0; i < x.cols(); ++i) low_pass(x.col(i), h);
  return x;
}

/// The robot without unknowns, and with one unit of the payload (or the same).
struct Models {
  robot::Model bare, loaded;

  Models(const Recording& recording, const Parameters& parameters) {
    const VectorXd zero = VectorXd::Zero(parameters.size());
    experiment::Scenario plant = parameters.plant(recording.scenario, zero);
    bare = experiment::with_payload(plant, *plant.model);
    bare.rotor_inertia = plant.robot.rigid_rotor_inertia_kgm2;
    plant.plant.payload.mass_kg += 1;
    loaded = experiment::with_payload(plant, *plant.model);
    loaded.rotor_inertia = bare.rotor_inertia;
    drive = plant.plant.drive;
  }

  plant::DriveSpec drive;
};

double sign(double x) { return x > 0 ? 1 : x < 0 ? -1 : 0; }

}  // namespace

VectorXd Regression::residual(const VectorXd& values) const {
  const VectorXd left = torque - columns * values;
  VectorXd sum = VectorXd::Zero(peak.size()), count = VectorXd::Zero(peak.size());
  for (Eigen::Index row = 0; row < left.size(); ++row) {
    sum[joint[row]] += left[row] * left[row];
    count[joint[row]] += 1;
  }
  return sum.cwiseQuotient(count).cwiseSqrt();
}

Regression regression(const Recording& recording, const Parameters& parameters) {
  const double h = recording.scenario.loop.period_s;
  const Eigen::Index ticks = recording.num_ticks(), n = recording.q.cols(), p = parameters.size();
  const Models models(recording, parameters);
  const MatrixXd q = filtered(recording.q, h);
  // What acts at t_k: the torque is held over each tick.
  MatrixXd tau = recording.tau;
  tau.bottomRows(ticks - 1) = 0.5 * (recording.tau.topRows(ticks - 1) + tau.bottomRows(ticks - 1));
  MatrixXd left = filtered(tau, h);  // without the robot's own torque, below
  const MatrixXd whole = left;
  std::vector<MatrixXd> columns(static_cast<std::size_t>(p), MatrixXd::Zero(ticks, n));
  for (Eigen::Index k = 1; k + 1 < ticks; ++k) {
    const robot::Vector at = q.row(k).transpose();
    const robot::Vector v = (q.row(k + 1) - q.row(k - 1)).transpose() / (2 * h);
    const robot::Vector a = (q.row(k + 1) - 2 * q.row(k) + q.row(k - 1)).transpose() / (h * h);
    const robot::Vector own = robot::inverse_dynamics<double>(models.bare, at, v, a);
    robot::Vector friction = models.drive.viscous_friction_Nms_per_rad.cwiseProduct(v);
    for (Eigen::Index j = 0; j < n; ++j)
      friction[j] += models.drive.coulomb_friction_Nm[j] * sign(v[j]);
    left.row(k) -= (own + friction).transpose();
    for (Eigen::Index i = 0; i < p; ++i) {
      const auto& entry = parameters.entries()[static_cast<std::size_t>(i)];
      MatrixXd& column = columns[static_cast<std::size_t>(i)];
      switch (entry.kind) {
        case Kind::rotor:
          column(k, entry.joint) = a[entry.joint];
          break;
        case Kind::viscous:
          column(k, entry.joint) = v[entry.joint];
          break;
        case Kind::coulomb:
          column(k, entry.joint) = sign(v[entry.joint]);
          break;
        case Kind::payload:
          column.row(k) =
              (robot::inverse_dynamics<double>(models.loaded, at, v, a) - own).transpose();
      }
    }
  }
  left.row(0) = left.row(1);
  left.row(ticks - 1) = left.row(ticks - 2);
  left = filtered(std::move(left), h);
  for (MatrixXd& column : columns) column = filtered(std::move(column), h);

  const auto step = static_cast<Eigen::Index>(std::max(1.0, std::floor(0.2 / (cutoff_hz * h))));
  const auto edge = static_cast<Eigen::Index>(settle_s / h);
  const Eigen::Index instants = (ticks - 2 * edge + step - 1) / step;
  Regression result{MatrixXd(instants * n, p), VectorXd(instants * n),
                    Eigen::VectorXi(instants * n),
                    whole.cwiseAbs().colwise().maxCoeff().transpose()};
  Eigen::Index row = 0;
  for (Eigen::Index instant = 0; instant < instants; ++instant) {
    const Eigen::Index k = edge + instant * step;
    for (Eigen::Index j = 0; j < n; ++j, ++row) {
      for (Eigen::Index i = 0; i < p; ++i) {
        result.columns(row, i) = columns[static_cast<std::size_t>(i)](k, j);
      }
      result.torque[row] = left(k, j);
      result.joint[row] = static_cast<int>(j);
    }
  }
  return result;
}

VectorXd least_squares(const std::vector<Regression>& of) {
  const Eigen::Index p = of.front().columns.cols(), n = of.front().peak.size();
  VectorXd values = VectorXd::Zero(p), weight = VectorXd::Ones(n);
  for (const Regression& each : of)
    weight = weight.cwiseMin(each.peak.cwiseMax(1e-9).cwiseInverse());
  for (int pass = 0; pass < 3; ++pass) {
    MatrixXd normal = MatrixXd::Zero(p, p);
    VectorXd right = VectorXd::Zero(p), residual = VectorXd::Zero(n);
    for (const Regression& each : of) {
      const VectorXd w =
          each.joint.unaryExpr([&](int j) { return weight[j] * weight[j]; }).cast<double>();
      normal += each.columns.transpose() * w.asDiagonal() * each.columns;
      right += each.columns.transpose() * w.cwiseProduct(each.torque);
    }
    values = normal.completeOrthogonalDecomposition().solve(right).cwiseMax(0);
    for (const Regression& each : of) residual = residual.cwiseMax(each.residual(values));
    weight = residual.cwiseMax(1e-9).cwiseInverse();
  }
  return values;
}

}  // namespace tachless::identify

#include "identify/least_squares.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>

#include "identify/physical_inertia.h"
#include "numerics/decompositions.h"
#include "robot/dynamics.h"

namespace tachless::identify {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double cutoff_hz = 15;
/// Cutoff of the filter before the differences. The robot's torque is no linear function of the
/// positions, and only of signals far below the cutoff does it pass the filter unchanged.
constexpr double wide_hz = 40;
constexpr double settle_s = 0.3;  ///< left out at both ends because of the filter's transient
/// Twice the noise bandwidth of the filter in both directions: white noise has so many independent
/// values per second behind it. The integral of 1 / (1 + x^4)^2 is 0.833.
constexpr double independent_hz = 2 * 0.833 * cutoff_hz;
/// Share of a joint's largest speed below which its friction may be that of rest.
constexpr double slowest = 0.2;
/// Times around slow instants [s], the longest first that leaves enough rows. The filter's answer
/// to a wrong sign of the velocity falls to a thousandth within 0.1 s.
constexpr std::array<double, 4> guards_s = {0.1, 0.05, 0.025, 0};
constexpr double least_share = 0.2;  ///< of a joint's rows that are not slow
/// Share of a joint's largest speed below which it creeps, and the time before and after a reversal
/// [s]. The filter's answer to a wrong sign falls to a thousandth within this time.
constexpr double creeping = 0.02, reversal_s = 0.1;

/// Applies a second-order Butterworth low-pass forwards and backwards, which adds no phase.
void low_pass(Eigen::Ref<VectorXd> x, double h, double hz) {
  const double w = std::tan(std::numbers::pi * std::min(hz * h, 0.2));
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

/// Returns a model for each number of each body, with all else massless. Bodies after that one are
/// left out. The model of a first moment has a mass of 1 kg at 1 m.
std::vector<robot::Model> unit_models(const robot::Model& bare) {
  robot::Model empty = bare;
  empty.rotor_inertia = Vector::Zero(bare.num_joints);
  for (robot::MassProperties& each : empty.bodies) each = {};
  std::vector<robot::Model> all;
  for (std::size_t body = 0; body < bare.bodies.size(); ++body) {
    for (Eigen::Index c = 0; c < Inertial::SizeAtCompileTime; ++c) {
      Inertial unit = Inertial::Unit(c);
      if (c >= 1 && c <= 3) unit[0] = 1;
      robot::Model& model = all.emplace_back(empty);
      model.bodies.resize(body + 1);
      static_cast<robot::MassProperties&>(model.bodies[body]) = mass_properties(unit);
    }
  }
  return all;
}

/// Returns the arm with 1 kg at the load's frame, and with each number of a load besides. Their
/// differences are the load's columns; every model has a mass.
std::vector<robot::Model> load_models(const robot::Model& bare, const std::string& link) {
  std::vector<robot::Model> all;
  for (Eigen::Index c = -1; c < Inertial::SizeAtCompileTime; ++c) {
    Inertial load = Inertial::Unit(0);
    if (c >= 0) load += Inertial::Unit(c);
    all.push_back(robot::with_payload(bare, mass_properties(load), link));
  }
  return all;
}

/// The robot with all unknowns zero. If the payload is unknown, `loaded` has 1 kg of it.
struct Models {
  robot::Model bare, loaded;

  Models(const Recording& recording, const Parameters& parameters) {
    const VectorXd zero = VectorXd::Zero(parameters.size());
    scenario::Scenario plant = parameters.plant(recording.scenario, zero);
    const bool unknown = parameters.first(Kind::payload) >= 0;
    // The payload's own inertia stays, if it has one.
    if (unknown) plant.plant.payload.mass_kg = 1e-9;
    bare = scenario::with_payload(plant, *plant.model);
    bare.rotor_inertia = plant.robot.rigid_rotor_inertia_kgm2;
    drive = plant.plant.drive;
    if (parameters.first(Kind::inertia) >= 0) units = unit_models(bare);
    if (parameters.first(Kind::load) >= 0) {
      loads = load_models(bare, recording.scenario.plant.payload.link);
    }
    if (!unknown) return;
    plant.plant.payload.mass_kg += 1;
    loaded = scenario::with_payload(plant, *plant.model);
    loaded.rotor_inertia = bare.rotor_inertia;
  }

  plant::DriveSpec drive;
  std::vector<robot::Model> units, loads;  ///< for links and load, if these are unknown
};

/// Returns the derivative of tanh(v/v_r) by v_r.
double turn(double v, double v_r) {
  const double rise = robot::friction_rise(v, 1, v_r);
  return -v / (v_r * v_r) * (1 - rise * rise);
}

double sign(double x) { return x > 0 ? 1 : x < 0 ? -1 : 0; }

/// Sets `slow` of the rows of joint j.
void set_slow(Regression& regression, Eigen::Index j) {
  const Eigen::Index n = regression.peak.size(), instants = regression.torque.size() / n;
  const auto speed = [&](Eigen::Index k) { return std::abs(regression.speed[k * n + j]); };
  double largest = 0;
  for (Eigen::Index k = 0; k < instants; ++k) largest = std::max(largest, speed(k));
  const double step_s = instants > 1 ? regression.time_s[n] - regression.time_s[0] : 1;
  for (const double guard_s : guards_s) {
    const auto guard = static_cast<Eigen::Index>(std::ceil(guard_s / step_s - 1e-9));
    std::vector<bool> slow(static_cast<std::size_t>(instants), false);
    for (Eigen::Index k = 0; k < instants; ++k) {
      if (speed(k) >= slowest * largest) continue;
      const Eigen::Index from = std::max<Eigen::Index>(0, k - guard),
                         to = std::min(instants, k + guard + 1);
      std::fill(slow.begin() + from, slow.begin() + to, true);
    }
    for (Eigen::Index k = 0; k < instants; ++k) {
      regression.slow[static_cast<std::size_t>(k * n + j)] = slow[static_cast<std::size_t>(k)];
    }
    const auto fast = std::ranges::count(slow, false);
    if (static_cast<double>(fast) >= least_share * static_cast<double>(instants)) return;
  }
}

/// Sets `reversing` of the rows of joint j. Rows at both ends have nothing before or after them.
void set_reversing(Regression& regression, Eigen::Index j) {
  const Eigen::Index n = regression.peak.size(), instants = regression.torque.size() / n;
  VectorXd speed(instants);
  for (Eigen::Index k = 0; k < instants; ++k) speed[k] = regression.speed[k * n + j];
  const double least = instants > 0 ? creeping * speed.cwiseAbs().maxCoeff() : 0;
  const double step_s = instants > 1 ? regression.time_s[n] - regression.time_s[0] : 1;
  const auto guard = static_cast<Eigen::Index>(std::ceil(reversal_s / step_s));
  for (Eigen::Index k = 0; k < instants; ++k) {
    bool reversing = k < guard || k + guard >= instants || std::abs(speed[k]) < least;
    if (!reversing) {
      const auto near = speed.segment(k - guard, 2 * guard + 1);
      reversing = near.minCoeff() < 0 && near.maxCoeff() > 0;
    }
    regression.reversing[static_cast<std::size_t>(k * n + j)] = reversing;
  }
}

/// Selects the rows at every few instants and leaves out both ends.
/// @param columns one matrix per parameter, then one per rise with the derivative by its v_r, and
/// the deviations of the torque that are possible
/// @param torque one row per tick
/// @param whole scale of the torques, filtered once less than `applied`
/// @param at_rest_before the motion begins and ends without a jump of the filtered velocity, so
/// that `share` covers both ends
Regression thinned(const std::vector<MatrixXd>& columns, const MatrixXd& torque,
                   const MatrixXd& whole, const MatrixXd& applied, const MatrixXd& speed, double h,
                   bool at_rest_before) {
  const auto step = static_cast<Eigen::Index>(std::max(1.0, std::floor(0.2 / (cutoff_hz * h))));
  const auto edge = static_cast<Eigen::Index>(settle_s / h);
  const Eigen::Index instants = (torque.rows() - 2 * edge + step - 1) / step, n = torque.cols();
  Regression result{MatrixXd(instants * n, std::ssize(columns)),
                    {},
                    VectorXd(instants * n),
                    {},
                    VectorXd(instants * n),
                    VectorXd(instants * n),
                    Eigen::VectorXi(instants * n),
                    VectorXd(instants * n),
                    std::vector<bool>(static_cast<std::size_t>(instants * n)),
                    std::vector<bool>(static_cast<std::size_t>(instants * n)),
                    whole.cwiseAbs().colwise().maxCoeff().transpose(),
                    VectorXd(std::ssize(columns))};
  for (std::size_t i = 0; i < columns.size(); ++i) {
    const Eigen::Index out = at_rest_before ? 0 : edge;
    const VectorXd largest = columns[i]
                                 .middleRows(out, columns[i].rows() - 2 * out)
                                 .cwiseAbs()
                                 .colwise()
                                 .maxCoeff()
                                 .transpose();
    result.share[static_cast<Eigen::Index>(i)] =
        largest.cwiseQuotient(result.peak.cwiseMax(1e-300)).maxCoeff();
  }
  Eigen::Index row = 0;
  for (Eigen::Index instant = 0; instant < instants; ++instant) {
    const Eigen::Index k = edge + instant * step;
    for (Eigen::Index j = 0; j < n; ++j, ++row) {
      for (std::size_t i = 0; i < columns.size(); ++i) {
        result.columns(row, static_cast<Eigen::Index>(i)) = columns[i](k, j);
      }
      result.torque[row] = torque(k, j);
      result.applied[row] = applied(k, j);
      result.time_s[row] = static_cast<double>(k) * h;
      result.joint[row] = static_cast<int>(j);
      result.speed[row] = speed(k, j);
    }
  }
  for (Eigen::Index j = 0; j < n; ++j) {
    set_slow(result, j);
    set_reversing(result, j);
  }
  return result;
}

/// Filters both sides of the equations: the low-pass of 15 Hz twice.
MatrixXd smoothed(MatrixXd columns, double h) {
  return low_passed(low_passed(std::move(columns), h), h);
}

/// Filtered positions with their first and second differences over time.
struct Differences {
  Vector v, a;

  /// @param k instant, neither the first nor the last
  /// @param held the torque is held over each tick, with its mean over both ticks at k: the second
  /// difference of three positions is the mean of the acceleration over the same time. Otherwise
  /// the torque is that of the instant, and five positions give the instant's acceleration.
  Differences(const MatrixXd& q, Eigen::Index k, double h, bool held) {
    const auto row = [&](Eigen::Index by) -> Vector { return q.row(k + by).transpose(); };
    v = (row(1) - row(-1)) / (2 * h);
    a = (row(1) - 2 * row(0) + row(-1)) / (h * h);
    if (held || k < 2 || k + 2 >= q.rows()) return;
    v = (8 * (row(1) - row(-1)) - row(2) + row(-2)) / (12 * h);
    a = (16 * (row(1) + row(-1)) - 30 * row(0) - row(2) - row(-2)) / (12 * h * h);
  }
};

/// The filtered motion at an instant.
struct Instant {
  const Vector &q, &v, &a;
  const Vector& own;                   ///< torque of the robot with all unknowns zero
  const Vector& gravity;               ///< of that robot; zero if no friction grows with it
  const Eigen::RowVectorXd& per_tick;  ///< change of the torque that is sent, in a tick
};

/// Sets row k of the column of each parameter and of each unknown v_r.
void set_columns(const Recording& recording, const Parameters& parameters, const Models& models,
                 const Instant& at, Eigen::Index k, std::vector<MatrixXd>& columns) {
  const Eigen::Index inertia = parameters.first(Kind::inertia);
  const auto torque = [&](const robot::Model& model) {
    return robot::inverse_dynamics<double>(model, at.q, at.v, at.a);
  };
  const Vector light = models.loads.empty() ? at.own : torque(models.loads.front());
  auto turns = static_cast<std::size_t>(parameters.size());
  for (Eigen::Index i = 0; i < parameters.size(); ++i) {
    const auto& entry = parameters.entries()[static_cast<std::size_t>(i)];
    MatrixXd& column = columns[static_cast<std::size_t>(i)];
    switch (entry.kind) {
      case Kind::rotor:
        column(k, entry.joint) = at.a[entry.joint];
        break;
      case Kind::viscous:
        column(k, entry.joint) = at.v[entry.joint];
        break;
      case Kind::coulomb:
        column(k, entry.joint) = sign(at.v[entry.joint]);
        break;
      case Kind::rise:
        column(k, entry.joint) = robot::friction_rise(at.v[entry.joint], 1, entry.velocity);
        if (entry.turns) columns[turns++](k, entry.joint) = turn(at.v[entry.joint], entry.velocity);
        break;
      case Kind::load_friction:
        column(k, entry.joint) = sign(at.v[entry.joint]) * std::abs(at.gravity[entry.joint]);
        break;
      case Kind::payload:
        column.row(k) = (torque(models.loaded) - at.own).transpose();
        break;
      case Kind::delay:
        column.row(k) = at.per_tick;
        break;
      case Kind::inertia:
        column.row(k) = torque(models.units[static_cast<std::size_t>(i - inertia)]).transpose();
        if (entry.component >= 1 && entry.component <= 3) {
          column.row(k) -= columns[static_cast<std::size_t>(i - entry.component)].row(k);
        }
        break;
      case Kind::offset:
        column(k, entry.joint) = 1;
        break;
      case Kind::load:
        if (!recording.loaded) break;
        column.row(k) =
            (torque(models.loads[static_cast<std::size_t>(entry.component + 1)]) - light)
                .transpose();
        break;
    }
  }
}

}  // namespace

MatrixXd low_passed(MatrixXd columns, double h, double hz) {
  for (Eigen::Index i = 0; i < columns.cols(); ++i) low_pass(columns.col(i), h, hz);
  return columns;
}

VectorXd Regression::residual(const VectorXd& values, const std::vector<RowUse>& rows) const {
  return rms(torque - columns * values, rows);
}

VectorXd Regression::rms(const VectorXd& x, const std::vector<RowUse>& rows) const {
  VectorXd sum = VectorXd::Zero(peak.size()), count = VectorXd::Constant(peak.size(), 1e-300);
  for (Eigen::Index row = 0; row < x.size(); ++row) {
    if (!rows.empty() && !used(row, rows)) continue;
    sum[joint[row]] += x[row] * x[row];
    count[joint[row]] += 1;
  }
  return sum.cwiseQuotient(count).cwiseSqrt();
}

double rows_alike(const Regression& regression) {
  const Eigen::Index n = regression.peak.size();
  if (regression.time_s.size() <= n) return 1;
  return std::max(1.0, 1 / (independent_hz * (regression.time_s[n] - regression.time_s[0])));
}

Regression regression(const Recording& recording, const Parameters& parameters) {
  const double h = recording.scenario.loop.period_s;
  const Eigen::Index ticks = recording.num_ticks(), n = recording.q.cols(), p = parameters.size();
  const Models models(recording, parameters);
  const MatrixXd q = low_passed(recording.q, h, wide_hz);
  // Mean torque about t_k, because each torque is held over its tick.
  const auto mean = [&](MatrixXd tau) {
    if (recording.controlled) {
      tau.bottomRows(ticks - 1) =
          0.5 * (MatrixXd(tau.topRows(ticks - 1)) + tau.bottomRows(ticks - 1));
    }
    return low_passed(std::move(tau), h, wide_hz);
  };
  MatrixXd left = mean(recording.tau);  // the robot's own torque is subtracted below
  const MatrixXd whole = left, sent = mean(sent_torque(recording));
  const Eigen::Index delay = parameters.first(Kind::delay);
  const Eigen::Index rises = parameters.num_turning();
  std::vector<MatrixXd> columns(static_cast<std::size_t>(p + rises + 2), MatrixXd::Zero(ticks, n));
  MatrixXd &of_instants = columns[columns.size() - 2], &of_own = columns.back();
  MatrixXd speed = MatrixXd::Zero(ticks, n);
  const plant::DriveSpec& drive = models.drive;
  const bool loaded = parameters.first(Kind::load_friction) >= 0 || !drive.load_friction.isZero(0);
  // Ticks of delay that the torques have already.
  const double had = recording.controlled ? recording.scenario.loop.command_delay : recording.moved;
  for (Eigen::Index k = 1; k + 1 < ticks; ++k) {
    const Vector at = q.row(k).transpose();
    const auto [v, a] = Differences(q, k, h, recording.controlled);
    const Vector own = robot::inverse_dynamics<double>(models.bare, at, v, a);
    Vector friction = models.drive.viscous_friction_Nms_per_rad.cwiseProduct(v);
    const Vector gravity = loaded ? robot::gravity_torque(models.bare, at) : Vector(0 * at);
    for (Eigen::Index j = 0; j < n; ++j) {
      friction[j] += models.drive.friction_of(j).kinetic(v[j], gravity[j]);
    }
    left.row(k) -= (own + friction).transpose();
    // A delay of d ticks gives tau(t - d h) = tau - d h taudot to first order.
    const Eigen::RowVectorXd per_tick = 0.5 * (sent.row(k + 1) - sent.row(k - 1));
    if (delay >= 0) left.row(k) += had * per_tick;
    if (!recording.controlled) {
      // The mean of two held torques is the motion's torque and a twelfth of its second difference.
      // The middle between that and the torque of an instant is taken.
      of_instants.row(k) = (whole.row(k + 1) - 2 * whole.row(k) + whole.row(k - 1)) / 24;
      left.row(k) -= of_instants.row(k);
    }
    if (recording.own.size() > 0) {
      of_own.row(k) =
          0.5 * recording.own_late * (recording.own.row(k + 1) - recording.own.row(k - 1));
    }
    speed.row(k) = v.transpose();
    if (p > 0)
      set_columns(recording, parameters, models, {at, v, a, own, gravity, per_tick}, k, columns);
  }
  left.row(0) = left.row(1);
  left.row(ticks - 1) = left.row(ticks - 2);
  left = smoothed(std::move(left), h);
  for (MatrixXd& column : columns) column = smoothed(std::move(column), h);

  Regression result = thinned(columns, left, whole, smoothed(whole, h),
                              smoothed(std::move(speed), h), h, recording.controlled);
  result.turns = result.columns.middleCols(p, rises);
  result.unsure = result.columns.rightCols<2>();
  result.columns.conservativeResize(Eigen::NoChange, p);
  result.share.conservativeResize(p);
  return result;
}

namespace {

constexpr int passes = 4;
constexpr int num_blocks = 20;               ///< of time, for the covariance
constexpr int num_windows = num_blocks + 1;  ///< of time, with their middles at the blocks' ends

/// All rows, each multiplied by its joint's weight.
struct Weighted {
  MatrixXd columns, turns, unsure;
  VectorXd torque;
};

/// Rows that are not used have weight 0.
Weighted weighted(const std::vector<Regression>& regressions, const VectorXd& weight,
                  const std::vector<RowUse>& used) {
  Eigen::Index size = 0, row = 0;
  for (const Regression& each : regressions) size += each.torque.size();
  const Regression& first = regressions.front();
  Weighted all{MatrixXd(size, first.columns.cols()), MatrixXd(size, first.turns.cols()),
               MatrixXd(size, first.unsure.cols()), VectorXd(size)};
  for (const Regression& each : regressions) {
    for (Eigen::Index i = 0; i < each.torque.size(); ++i, ++row) {
      const double w = each.used(i, used) ? weight[each.joint[i]] : 0;
      all.columns.row(row) = w * each.columns.row(i);
      all.turns.row(row) = w * each.turns.row(i);
      all.torque[row] = w * each.torque[i];
      all.unsure.row(row) = w * each.unsure.row(i);
    }
  }
  return all;
}

/// Returns Student's 97.5 % quantile to within 1 % from one degree of freedom on. It is the normal
/// quantile with the first term of its expansion and a fit of the others.
double quantile(double freedom) {
  const double x = 1 / std::max(1.0, freedom);
  return 1.96 * std::exp(x * (1.21 + x * (0.735 - 0.075 * x)));
}

/// A normal matrix, split into what is determined and what is not. The columns behind it are scaled
/// to norm 1 for that.
struct Determined {
  VectorXd value;    ///< determined eigenvalues, ascending
  MatrixXd vectors;  ///< V with V' N V = diag(value)
  MatrixXd free;     ///< projector onto the undetermined combinations of the scaled columns

  explicit Determined(const MatrixXd& N) {
    // Share of the largest eigenvalue that counts as zero: a condition of 3e4.
    constexpr double zero = 1e-9;
    const VectorXd square = N.diagonal();
    // A norm below 1e-10 of the largest is a rounding error.
    const VectorXd unit =
        square.cwiseMax(std::max(1e-20 * square.maxCoeff(), 1e-300)).cwiseSqrt().cwiseInverse();
    const auto [all, V] = numerics::symmetric_eigen(unit.asDiagonal() * N * unit.asDiagonal());
    const Eigen::Index null = (all.array() < zero * all.maxCoeff()).count();
    value = all.tail(all.size() - null);
    vectors = unit.asDiagonal() * V.rightCols(all.size() - null);
    free = V.leftCols(null) * V.leftCols(null).transpose();
  }

  /// Returns the solution of N x = b, zero in what is not determined, for each column of b.
  [[nodiscard]] MatrixXd solution(const MatrixXd& b) const {
    return vectors * ((vectors.transpose() * b).array().colwise() / value.array()).matrix();
  }

  /// Returns the variances of the parameters for white residuals of variance 1.
  [[nodiscard]] VectorXd variances() const { return vectors.cwiseAbs2() * value.cwiseInverse(); }
};

/// The normal equations of all rows, of the prior and of windows of time. The blocks between the
/// windows' middles have the same sum of leverages, if none is then shorter than half a block of
/// equal lengths: residuals stay correlated for some time. A window falls linearly to zero over a
/// block on both sides of its middle, and the windows' sum is 1. Residuals that positions'
/// quantisation leaves are differences, and their sum over a window with sharp ends would be that
/// of its ends.
struct Normals {
  MatrixXd rows;                  ///< normal matrix of all rows of the Jacobian
  MatrixXd prior;                 ///< rows of the prior
  double alike = 1;               ///< as in `Prior`
  std::vector<MatrixXd> windows;  ///< normal matrices, each row with the window's weight
  std::vector<MatrixXd> squares;  ///< each row with the square of the weight
  std::vector<MatrixXd> shared;   ///< each row with the product of this and the next weight
  std::vector<VectorXd> slopes;   ///< of the windows: columns' products with the residual
  VectorXd slope;                 ///< columns' products with the residual
  MatrixXd unsure;                ///< columns' products with each deviation

  Normals(const MatrixXd& J, const VectorXd& residual, const Prior& known,
          const MatrixXd& deviations)
      : rows(J.transpose() * J),
        prior(known.rows.rows() > 0 ? known.rows : MatrixXd(0, J.cols())),
        alike(known.alike),
        windows(num_windows, MatrixXd::Zero(J.cols(), J.cols())),
        squares(windows),
        shared(windows),
        slopes(num_windows, VectorXd::Zero(J.cols())),
        slope(J.transpose() * residual) {
    const Determined found(whole());
    const VectorXd leverage =
        (J * (found.vectors * found.value.cwiseSqrt().cwiseInverse().asDiagonal()))
            .rowwise()
            .squaredNorm();
    const Eigen::Index least = J.rows() / (2 * num_blocks);
    double left = leverage.sum();
    Eigen::Index from = 0, to = 0;
    for (int b = 0; b < num_blocks; ++b, from = to) {
      const int rest = num_blocks - b;
      const Eigen::Index last = J.rows() - (rest - 1) * least;
      to = rest == 1 ? last : std::min(from + least, last);
      double sum = leverage.segment(from, to - from).sum();
      while (to < last && sum < left / rest) sum += leverage[to++];
      left -= sum;
      add(static_cast<std::size_t>(b), J.middleRows(from, to - from),
          residual.segment(from, to - from));
    }
    unsure = deviations.size() > 0 ? MatrixXd(J.transpose() * deviations) : MatrixXd(0 * slope);
  }

  /// Returns the normal matrix of the rows and of the prior.
  [[nodiscard]] MatrixXd whole() const { return rows + alike * prior.transpose() * prior; }

  /// Changes the parameters to the coordinates x of T x.
  void transform(const MatrixXd& T) {
    rows = T.transpose() * rows * T;
    prior = prior * T;
    for (auto* const matrices : {&windows, &squares, &shared}) {
      for (MatrixXd& each : *matrices) each = T.transpose() * each * T;
    }
    for (VectorXd& each : slopes) each = T.transpose() * each;
    slope = T.transpose() * slope;
    unsure = T.transpose() * unsure;
  }

  /// Moves the estimate by x. The residual changes with it.
  void move(const VectorXd& x) {
    slope -= rows * x;
    for (std::size_t w = 0; w < windows.size(); ++w) slopes[w] -= windows[w] * x;
  }

 private:
  /// Adds the block between the middles of windows b and b + 1.
  void add(std::size_t b, const MatrixXd& block, const VectorXd& residual) {
    const VectorXd next = (VectorXd::LinSpaced(block.rows(), 0, block.rows() - 1).array() + 0.5) /
                          static_cast<double>(block.rows());
    const MatrixXd after = next.asDiagonal() * block, before = block - after;
    const MatrixXd both = before.transpose() * after, first = before.transpose() * before,
                   second = after.transpose() * after;
    windows[b] += first + both;
    windows[b + 1] += second + both;
    squares[b] += first;
    squares[b + 1] += second;
    shared[b] = both;
    slopes[b] += before.transpose() * residual;
    slopes[b + 1] += after.transpose() * residual;
  }
};

/// Half widths of combinations, and their changes: as `Precision::moves`.
struct Widths {
  VectorXd half;
  MatrixXd moves;
};

/// Returns the half widths of the 95 % intervals of C times the least-squares solution. They are
/// the solution's changes when each window of time is left out, so correlated residuals count
/// correctly, and those by the prior. The sum of squares is scaled to have no bias for white
/// residuals, and Student's quantile has its degrees of freedom for those (R. Bell, D. McCaffrey,
/// Bias reduction in standard errors for linear regression with multi-stage samples, Survey
/// Methodology 28(2), 2002). The prior's variance is known and has no end of them (F.
/// Satterthwaite, Biometrics Bulletin 2(6), 1946).
Widths half_widths(const Normals& normals, const MatrixXd& C) {
  const MatrixXd N = normals.whole(), inverse = numerics::inverse(N);
  std::vector<MatrixXd> without;  // solutions of the other windows
  Widths result{VectorXd(C.rows()), MatrixXd(C.rows(), num_windows + normals.prior.rows())};
  for (Eigen::Index w = 0; w < num_windows; ++w) {
    const auto at = static_cast<std::size_t>(w);
    without.emplace_back(numerics::inverse(N - normals.windows[at]) * C.transpose());
    result.moves.col(w) = without.back().transpose() * normals.slopes[at];
  }
  result.moves.rightCols(normals.prior.rows()) =
      normals.alike * C * inverse * normals.prior.transpose();
  for (Eigen::Index i = 0; i < C.rows(); ++i) {
    MatrixXd seen(N.rows(), num_windows), covariance = MatrixXd::Zero(num_windows, num_windows);
    for (std::size_t w = 0; w < normals.windows.size(); ++w) {
      const auto at = static_cast<Eigen::Index>(w);
      const VectorXd x = without[w].col(i);
      seen.col(at) = normals.windows[w] * x;
      covariance(at, at) = x.dot(normals.squares[w] * x);
      if (w == 0) continue;
      covariance(at - 1, at) = covariance(at, at - 1) =
          without[w - 1].col(i).dot(normals.shared[w - 1] * x);
    }
    covariance -= seen.transpose() * inverse * seen;
    const VectorXd c = inverse * C.row(i).transpose();
    const double white = c.dot(normals.rows * c) / covariance.trace();
    if (white > 0 && std::isfinite(white)) {
      result.moves.row(i).head(num_windows) *= std::sqrt(white);
    }
    const double by_windows = result.moves.row(i).head(num_windows).squaredNorm();
    const double variance =
        by_windows + result.moves.row(i).tail(normals.prior.rows()).squaredNorm();
    // The prior alone tells a combination that no window moves.
    const double freedom = by_windows > 0
                               ? std::pow(covariance.trace(), 2) / covariance.squaredNorm() *
                                     std::pow(variance / by_windows, 2)
                               : std::numeric_limits<double>::infinity();
    const double width = quantile(freedom) * std::sqrt(variance);
    result.half[i] = std::isfinite(width) ? width : std::numeric_limits<double>::infinity();
  }
  return result;
}

/// Returns the half width of a 95 % interval for a parameter that is known up to +-`by` if the
/// interval without that is `width` (G. Imbens, C. Manski, Confidence intervals for partially
/// identified parameters, Econometrica 72(6), 2004). For a large `by` the error is to one side. The
/// quantile then goes from 1.96 to 1.645, here by a fit to within 1 %.
double widened(double width, double by) {
  if (!(width > 0) || by == 0) return width + by;
  constexpr double one_sided = 1.645 / 1.96;
  const double deviations = 2 * by * 1.96 / width;
  return by + width * (one_sided + (1 - one_sided) * std::exp(-2 * deviations));
}

/// Returns the numbers of the parameters that are not at their bound.
std::vector<Eigen::Index> inside(Eigen::Index size, const std::vector<bool>& at_bound) {
  std::vector<Eigen::Index> result;
  for (Eigen::Index i = 0; i < size; ++i) {
    if (at_bound.empty() || !at_bound[static_cast<std::size_t>(i)]) result.push_back(i);
  }
  return result;
}

/// Precision of some of the parameters, while the others are held.
struct Part {
  Widths widths;
  MatrixXd unsure;
  std::vector<bool> by_prior;

  /// @param kept numbers of these parameters
  /// @param freed the last of them is at its bound in the estimate. The estimate is moved to where
  /// it is free; the others' slopes with that of the prior are zero.
  Part(Normals normals, const std::vector<Eigen::Index>& kept, bool freed) {
    const MatrixXd all = MatrixXd::Identity(normals.rows.rows(), normals.rows.rows());
    normals.transform(all(Eigen::all, kept));
    const Determined found(normals.whole());
    unsure = found.solution(normals.unsure);
    if (freed) {
      VectorXd slope = VectorXd::Zero(normals.slope.size());
      slope.tail<1>() = normals.slope.tail<1>();
      normals.move(found.solution(slope));
    }
    set_by_prior(normals, found);
    normals.transform(found.vectors);
    widths = half_widths(normals, found.vectors);
  }

 private:
  void set_by_prior(const Normals& normals, const Determined& found) {
    by_prior.assign(static_cast<std::size_t>(unsure.rows()), false);
    if (normals.prior.rows() == 0) return;
    constexpr double larger = 4;  // variance without the prior
    const Determined alone(normals.rows);
    const VectorXd with = found.variances(), without = alone.variances();
    for (Eigen::Index i = 0; i < with.size(); ++i) {
      by_prior[static_cast<std::size_t>(i)] =
          alone.free(i, i) > 1e-6 || without[i] > larger * with[i];
    }
  }
};

}  // namespace

std::vector<bool> at_bound(const Parameters& parameters, const VectorXd& values) {
  std::vector<bool> result;
  for (Eigen::Index i = 0; i < values.size(); ++i) {
    result.push_back(parameters.entries()[static_cast<std::size_t>(i)].not_negative &&
                     values[i] <= 0);
  }
  return result;
}

Precision precision(const MatrixXd& J, const VectorXd& residual, const std::vector<bool>& at_bound,
                    const Prior& prior, const MatrixXd& unsure) {
  const Normals normals(J, residual, prior, unsure);
  const Determined all(normals.rows);
  Precision result{VectorXd(J.cols()),
                   all.value.size(),
                   std::sqrt(all.value.maxCoeff() / all.value.minCoeff()),
                   all.free,
                   MatrixXd::Zero(J.cols(), num_windows + prior.rows.rows()),
                   std::vector<bool>(static_cast<std::size_t>(J.cols())),
                   MatrixXd::Zero(J.cols(), normals.unsure.cols())};
  // Takes parameter i of the result from number `from` of a part.
  const auto take = [&](const Part& part, Eigen::Index from, Eigen::Index i) {
    result.unsure.row(i) = part.unsure.row(from);
    result.half_width[i] = widened(part.widths.half[from], result.unsure.row(i).lpNorm<1>());
    result.by_prior[static_cast<std::size_t>(i)] = part.by_prior[static_cast<std::size_t>(from)];
  };
  std::vector<Eigen::Index> free = inside(J.cols(), at_bound);
  if (!free.empty()) {
    const Part part(normals, free, false);
    for (std::size_t i = 0; i < free.size(); ++i) take(part, static_cast<Eigen::Index>(i), free[i]);
    result.moves(free, Eigen::all) = part.widths.moves;
  }
  for (Eigen::Index i = 0; i < J.cols(); ++i) {
    if (at_bound.empty() || !at_bound[static_cast<std::size_t>(i)]) continue;
    free.push_back(i);
    take(Part(normals, free, true), std::ssize(free) - 1, i);
    result.unsure.row(i).setZero();
    free.pop_back();
  }
  return result;
}

Precision precision_of_first(Eigen::Index size, const MatrixXd& J, const VectorXd& residual,
                             std::vector<bool> at_bound, const Prior& prior,
                             const MatrixXd& unsure) {
  at_bound.resize(static_cast<std::size_t>(J.cols()), false);
  Prior padded{MatrixXd::Zero(prior.rows.rows(), prior.rows.rows() > 0 ? J.cols() : 0),
               prior.alike};
  if (prior.rows.rows() > 0) padded.rows.leftCols(size) = prior.rows;
  Precision result = precision(J, residual, at_bound, padded, unsure);
  result.rank -= std::min(J.cols() - size, result.rank);
  result.half_width.conservativeResize(size);
  result.free = MatrixXd(result.free.topLeftCorner(size, size));
  result.moves.conservativeResize(size, Eigen::NoChange);
  result.by_prior.resize(static_cast<std::size_t>(size));
  result.unsure.conservativeResize(size, Eigen::NoChange);
  return result;
}

Fitted fitted(const MatrixXd& J, const VectorXd& y) {
  Fitted result;
  result.values = Determined(J.transpose() * J).solution(J.transpose() * y);
  static_cast<Precision&>(result) = precision(J, y - J * result.values);
  return result;
}

double Precision::half_width_of(const VectorXd& combination) const {
  double most = 1.96;
  for (Eigen::Index i = 0; i < combination.size(); ++i) {
    const double moved = moves.row(i).norm();
    const double own = half_width[i] - unsure.row(i).lpNorm<1>();
    if (combination[i] != 0 && moved > 0) most = std::max(most, own / moved);
  }
  return most * (combination.transpose() * moves).norm() +
         (combination.transpose() * unsure).lpNorm<1>();
}

namespace {

/// The normal equations of the parameters for the least squares of them and of the rises' v_r: N
/// and b lack what changes of v_r explain.
struct WithTurns {
  MatrixXd N;
  VectorXd b;

  explicit WithTurns(const Weighted& rows)
      : N(rows.columns.transpose() * rows.columns), b(rows.columns.transpose() * rows.torque) {
    if (rows.turns.cols() == 0) return;
    turns_.emplace(rows.turns.transpose() * rows.turns);
    both_ = rows.turns.transpose() * rows.columns;
    seen_ = rows.turns.transpose() * rows.torque;
    const MatrixXd half = turns_->vectors.transpose() * both_;
    const VectorXd inverse = turns_->value.cwiseInverse();
    N -= half.transpose() * inverse.asDiagonal() * half;
    b -= half.transpose() * inverse.asDiagonal() * turns_->vectors.transpose() * seen_;
  }

  /// Returns the changes of v_r times the rises, for these values of the parameters.
  [[nodiscard]] VectorXd turns(const VectorXd& values) const {
    return turns_ ? VectorXd(turns_->solution(seen_ - both_ * values)) : VectorXd();
  }

 private:
  std::optional<Determined> turns_;
  MatrixXd both_;
  VectorXd seen_;
};

/// Computes the precision of the parameters, with the v_r of each rise as one more that is unknown.
Precision precision_of(const Weighted& rows, const Parameters& parameters, const Prior& prior,
                       const LeastSquares& found) {
  MatrixXd J(rows.columns.rows(), rows.columns.cols() + rows.turns.cols());
  J << rows.columns, rows.turns;
  const VectorXd left = rows.torque - rows.columns * found.values - rows.turns * found.turns;
  return precision_of_first(parameters.size(), J, left, at_bound(parameters, found.values), prior,
                            rows.unsure);
}

/// Computes which parameters are determined, alone or in sums, and how well.
void set_intervals(const Weighted& rows, const Parameters& parameters, const Prior& prior,
                   LeastSquares& result) {
  static_cast<Precision&>(result) = precision_of(rows, parameters, prior, result);
  const Eigen::Index size = parameters.size();
  result.sums.resize(static_cast<std::size_t>(size));
  for (Eigen::Index i = 0; i < size; ++i) {
    if (result.free(i, i) < 1e-6) continue;
    result.half_width[i] = std::numeric_limits<double>::infinity();
    std::string& with = result.sums[static_cast<std::size_t>(i)];
    for (Eigen::Index j = 0; j < size; ++j) {
      if (j == i || std::abs(result.free(i, j)) < 0.2 * result.free(i, i)) continue;
      const auto& entry = parameters.entries()[static_cast<std::size_t>(j)];
      with += (with.empty() ? "" : ", ") + entry.name;
    }
    if (with.empty()) with = "nothing";
  }
}

}  // namespace

LeastSquares least_squares(const std::vector<Regression>& regressions, const Parameters& parameters,
                           const robot::Model& model, const std::vector<RowUse>& rows_of_joints) {
  const Eigen::Index n = regressions.front().peak.size();
  const std::vector<RowUse> used =
      rows_of_joints.empty() ? std::vector<RowUse>(static_cast<std::size_t>(n), RowUse::fast)
                             : rows_of_joints;
  LeastSquares result;
  VectorXd weight = VectorXd::Ones(n);
  for (const Regression& each : regressions)
    weight = weight.cwiseMin(each.peak.cwiseMax(1e-9).cwiseInverse());
  for (int pass = 0; pass < passes; ++pass) {
    const Weighted rows = weighted(regressions, weight, used);
    // Rows of one recording are as far apart as those of the others, if their loggers agree.
    const double alike = rows_alike(regressions.front());
    const WithTurns fit(rows);
    PossibleValues found = possible_values(fit.N / alike, fit.b / alike, parameters, model);
    result.values = std::move(found.values);
    result.turns = fit.turns(result.values);
    if (pass + 1 == passes) {
      set_intervals(rows, parameters, {std::move(found.prior), alike}, result);
    }
    VectorXd residual = VectorXd::Zero(n);
    for (const Regression& each : regressions) {
      residual = residual.cwiseMax(each.residual(result.values, used));
    }
    weight = residual.cwiseMax(1e-9).cwiseInverse();
  }
  return result;
}

}  // namespace tachless::identify

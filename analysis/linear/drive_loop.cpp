#include "linear/drive_loop.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <utility>

#include "numerics/decompositions.h"
#include "plant/drive_loop.h"

namespace tachless::linear {
namespace {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXcd;

bool stable(const SplitLoop& loop) { return spectral_radius(loop.map()) < 1; }

/// Returns the loop with its host's torque later by that many ticks of the drives.
SplitLoop later(SplitLoop loop, int ticks) {
  const auto period = static_cast<int>(std::lround(loop.period_s / loop.drive.period_s));
  const int all = loop.drive.late_ticks + ticks;
  loop.delay += all / period;
  loop.drive.late_ticks = all % period;
  return loop;
}

/// One period of the host with torques d added to those that act in each tick of the drives, and
/// these sums as outputs: x' = A x + B d, out = C x + D d.
struct Lifted {
  MatrixXd A, B, C, D;
};

Lifted lifted(const SplitLoop& loop) {
  const LinearPlant plant = loop.plant();
  const DriveTicks& drive = *plant.drive;
  const LinearLaw& law = loop.law;
  const Index n = plant.num_joints, x = plant.A.rows(), s = law.A.rows(), way = x + s;
  const Index all = way + loop.delay * n, acting = drive.acting(n);
  const auto ticks = static_cast<Index>(std::lround(loop.period_s / drive.period_s));
  const MatrixXd flow = numerics::exponential(plant.A * drive.period_s);
  const MatrixXd measured = measured_rows(law.measured, n, x);
  MatrixXd torque = MatrixXd::Zero(n, all);
  torque.leftCols(x) = law.D * measured;
  torque.middleCols(x, s) = law.C;
  MatrixXd used = torque;  // that comes into use in this period
  if (loop.delay > 0) {
    used.setZero();
    used.rightCols(n).setIdentity();
  }
  Lifted result{MatrixXd::Identity(all, all), MatrixXd::Zero(all, ticks * n),
                MatrixXd(ticks * n, all), MatrixXd(ticks * n, ticks * n)};
  for (Index j = 0; j < ticks; ++j) {
    if (j == loop.drive.late_ticks) {
      result.A.middleRows(x - n, n) = used;
      result.B.middleRows(x - n, n).setZero();
    }
    result.A.topRows(x) = drive.jump * result.A.topRows(x);
    result.B.topRows(x) = drive.jump * result.B.topRows(x);
    result.B.block(acting, j * n, n, n) += MatrixXd::Identity(n, n);
    result.C.middleRows(j * n, n) = result.A.middleRows(acting, n);
    result.D.middleRows(j * n, n) = result.B.middleRows(acting, n);
    result.A.topRows(x) = flow * result.A.topRows(x);
    result.B.topRows(x) = flow * result.B.topRows(x);
  }
  set_law_rows(law, measured, loop.delay, result.A);
  if (loop.delay > 0) result.A.middleRows(way, n) = torque;
  return result;
}

/// Returns the largest singular value of S, by the power method.
double norm(const MatrixXcd& S) {
  constexpr int most = 300;
  constexpr double agreement = 1e-10;
  VectorXcd v(S.cols());
  for (Index i = 0; i < v.size(); ++i) {  // no symmetry of S leaves a part of it out
    v[i] = std::polar(1.0, 0.7 * static_cast<double>(i * i));
  }
  double value = 0;
  for (int k = 0; k < most; ++k) {
    const VectorXcd next = S.adjoint() * (S * v.normalized());
    const double now = std::sqrt(next.norm());
    v = next;
    if (std::abs(now - value) <= agreement * now) return now;
    value = now;
  }
  return value;
}

double drive_modulus(const SplitLoop& loop) {
  constexpr int points = 60;
  const Lifted whole = lifted(loop);
  MatrixXd balanced = whole.A;
  const Eigen::VectorXd scale = balance(balanced), inverse = scale.cwiseInverse();
  const FrequencyResponse response(numerics::real_schur(balanced), inverse.asDiagonal() * whole.B,
                                   whole.C * scale.asDiagonal());
  const auto w = frequencies(numerics::eigenvalues(balanced), loop.period_s, points);
  return least_over(w, [&](double at) {
    return 1 / norm(response.at(std::polar(1.0, at * loop.period_s)) + whole.D);
  });
}

}  // namespace

LinearPlant with_drive_loop(const LinearPlant& plant, const scenario::DriveLoopSpec& loop,
                            double host_period_s) {
  const Index n = plant.num_joints, x = plant.A.rows(), difference = x, velocity = x + n,
              acting = velocity + n, newest = acting + loop.delay_ticks * n, used = newest + n,
              all = used + n;
  const plant::VelocityFilter filter = plant::velocity_filter(loop);
  DriveTicks drive{loop.period_s, MatrixXd::Identity(all, all), x,
                   loop.late_ticks * loop.period_s / host_period_s};
  MatrixXd& jump = drive.jump;
  jump.block(difference, difference, n, n).setZero();
  jump.block(velocity, velocity, n, n) *= filter.forget;
  jump.block(velocity, difference, n, n).diagonal().setConstant(filter.rate);
  for (Index row = acting; row < newest; row += n) {
    jump.middleRows(row, n).setZero();
    jump.block(row, row + n, n, n).setIdentity();
  }
  jump.middleRows(newest, n).setZero();
  jump.block(newest, used, n, n).setIdentity();
  jump.block(newest, 0, n, n).diagonal() = -Eigen::VectorXd(loop.kp);
  jump.middleRows(newest, n) -=
      Eigen::VectorXd(loop.kd).asDiagonal() * MatrixXd(jump.middleRows(velocity, n));
  LinearPlant result{MatrixXd::Zero(all, all), MatrixXd::Zero(all, n), n, {}};
  result.A.topLeftCorner(x, x) = plant.A;
  result.A.block(0, acting, x, n) = plant.B;
  result.A.middleRows(difference, n).leftCols(x) = plant.A.topRows(n);  // qdot
  result.B.bottomRows(n).setIdentity();
  result.drive = std::move(drive);
  return result;
}

LinearPlant without_drive_loop(const LinearPlant& plant) {
  const Index n = plant.num_joints, x = plant.drive.value().arm_states;
  return {plant.A.topLeftCorner(x, x), plant.A.block(0, plant.drive->acting(n), x, n), n, {}};
}

DriveMargins drive_margins(const SplitLoop& loop) {
  DriveMargins result;
  if (!stable(loop)) return result;
  const auto stable_with = [&](double gain) {
    SplitLoop harder = loop;
    harder.drive.kp *= gain;
    harder.drive.kd *= gain;
    return stable(harder);
  };
  constexpr double factor = 1.1, largest_gain = 1e4;
  result.gain = infinity;
  for (double gain = 1; gain < largest_gain; gain *= factor) {
    if (stable_with(gain * factor)) continue;
    result.gain = edge(gain, gain * factor, 20, stable_with);
    break;
  }
  result.delay_ticks = largest_whole(0, most_drive_ticks, [&](int ticks) {
    SplitLoop slower = loop;
    slower.drive.delay_ticks += ticks;
    return stable(slower);
  });
  result.modulus = drive_modulus(loop);
  return result;
}

int host_delay_margin(const SplitLoop& loop) {
  if (!stable(loop)) return -1;
  const auto period = static_cast<int>(std::lround(loop.period_s / loop.drive.period_s));
  return largest_whole(0, most_host_ticks * period,
                       [&](int ticks) { return stable(later(loop, ticks)); });
}

Vector drive_count_torque(const scenario::DriveLoopSpec& loop, const Vector& count) {
  return (loop.kp + plant::velocity_filter(loop).rate * loop.kd).cwiseProduct(count);
}

}  // namespace tachless::linear

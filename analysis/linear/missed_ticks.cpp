#include "linear/missed_ticks.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

#include "numerics/decompositions.h"

namespace tachless::linear {
namespace {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;

/// The torque that the law gives of a map's state, in rows.
MatrixXd torque_rows(const LinearLaw& law, const LinearPlant& plant, Index states) {
  MatrixXd torque = law.D * measured_rows(law.measured, plant.num_joints, states);
  torque.middleCols(plant.A.rows(), law.A.rows()) += law.C;
  return torque;
}

/// The loop between the errors and their sources. Errors of the torque come from increments of the
/// law's torque. Errors of the measured positions come from second differences of the positions.
class Gains {
 public:
  /// @param S torques are counted in its columns, angles in those of its inverse's transpose
  Gains(const SampledLoop& loop, double period_s, const MatrixXd& S) : period_s_(period_s) {
    const LinearLaw law = loop.law(period_s);
    const CutLoop open = cut(loop.plant, law, period_s, loop.delay);
    const MatrixXd map = open.closed();
    const Index n = loop.plant.num_joints, x = loop.plant.A.rows(), m = law.A.rows();
    const auto parts = static_cast<Index>(law.measured.size());
    const MatrixXd measured = measured_rows(law.measured, n, map.rows());
    const MatrixXd torque = torque_rows(law, loop.plant, map.rows());
    MatrixXd into_law = MatrixXd::Zero(map.rows(), n * parts);
    into_law.middleRows(x, m) = law.B;

    const MatrixXd inverse_S = numerics::inverse(S);
    MatrixXd angles = MatrixXd::Zero(n * parts, n * parts), inverse_angles = angles;
    for (Index i = 0; i < parts; ++i) {
      angles.block(i * n, i * n, n, n) = inverse_S.transpose();
      inverse_angles.block(i * n, i * n, n, n) = S.transpose();
    }
    const std::array into = {MatrixXd(open.B * S), MatrixXd(into_law * angles)};
    const std::array out_of = {MatrixXd(inverse_S * torque), MatrixXd(inverse_angles * measured)};
    const numerics::Schur schur = numerics::real_schur(map);
    for (std::size_t i = 0; i < 4; ++i) from_to_[i] = {schur, into[i / 2], out_of[i % 2]};
    w_ = frequencies(balanced_eigenvalues(map), period_s, 400);
  }

  /// The largest singular value over all frequencies, from error `in` to what drives error `out`;
  /// 0: torque, 1: positions.
  [[nodiscard]] double largest(std::size_t out, std::size_t in) const {
    return -least_over(w_, [&](double w) { return -at(w, out, in); });
  }

 private:
  [[nodiscard]] double at(double w, std::size_t out, std::size_t in) const {
    const std::complex<double> z = std::polar(1.0, w * period_s_);
    const std::complex<double> difference = 1.0 - 1.0 / z;
    const MatrixXcd G =
        (out == 0 ? difference : z * difference * difference) * from_to_[2 * in + out].at(z);
    return std::sqrt(numerics::eigenvalues(MatrixXcd(G * G.adjoint())).real().maxCoeff());
  }

  double period_s_;
  std::array<FrequencyResponse, 4> from_to_;  ///< number 2 in + out
  std::vector<double> w_;
};

/// Returns units in which joints of very different size weigh alike. They are the square roots of
/// the inertia that a torque accelerates, and of the law's own gains.
std::vector<MatrixXd> scalings(const SampledLoop& loop, double period_s) {
  const Index n = loop.plant.num_joints;
  MatrixXd mobility = MatrixXd::Zero(n, n);
  // Behind current loops, which come last, that of their torques; scaled torques break its
  // symmetry.
  const auto& drive = loop.plant.drive;
  const Index x = loop.plant.arm_states();
  const bool lags = x % (2 * n) != 0;
  const MatrixXd B = lags    ? MatrixXd(loop.plant.A.block(0, x - n, x - n, n))
                     : drive ? MatrixXd(loop.plant.A.block(0, drive->acting(n), x, n))
                             : loop.plant.B;
  for (Index k = 0; k < B.rows(); k += n) mobility += B.middleRows(k, n);
  const auto [values, vectors] = numerics::symmetric_eigen((mobility + mobility.transpose()) / 2);
  const LinearLaw law = loop.law(period_s);
  Eigen::VectorXd own = Eigen::VectorXd::Zero(n);
  for (Index part = 0; part < static_cast<Index>(law.measured.size()); ++part) {
    own = own.cwiseMax(law.D.middleCols(part * n, n).diagonal().cwiseAbs());
  }
  return {vectors * values.cwiseSqrt().cwiseInverse().asDiagonal() * vectors.transpose(),
          MatrixXd(own.cwiseSqrt().asDiagonal())};
}

bool measures_positions_alone(const std::vector<Part>& measured) {
  return std::ranges::all_of(measured,
                             [](Part part) { return part == Part::q || part == Part::theta; });
}

}  // namespace

double gain_of_missed_commands(int m) {
  return m == 0 ? 0 : 1 / (2 * std::sin(std::numbers::pi / (4 * m + 2)));
}

double gain_of_missed_measurements(int m) {
  const double s = std::sin(std::numbers::pi / (2 * (m + 1)));
  return m == 0 ? 0 : 1 / (4 * s * s);
}

HeldMaps held_maps(const SampledLoop& loop, double period_s) {
  const LinearLaw law = loop.law(period_s);
  const CutLoop open = cut(loop.plant, law, period_s, loop.delay);
  const MatrixXd map = open.closed();
  const Index n = loop.plant.num_joints, all = map.rows();
  const MatrixXd torque = torque_rows(law, loop.plant, all);
  HeldMaps maps{MatrixXd::Zero(all + n, all + n), MatrixXd::Zero(all + n, all + n)};
  maps.hit.topLeftCorner(all, all) = map;
  maps.hit.bottomLeftCorner(n, all) = torque;
  maps.missed.topLeftCorner(all, all) = map - open.B * torque;
  maps.missed.topRightCorner(all, n) = open.B;
  maps.missed.bottomRightCorner(n, n).setIdentity();
  return maps;
}

MissedTicks missed_ticks(const SampledLoop& loop, double period_s) {
  MissedTicks result;
  const bool positions = measures_positions_alone(loop.law(period_s).measured);
  if (positions) result.measurements = 0;
  for (const MatrixXd& S : scalings(loop, period_s)) {
    const Gains gains(loop, period_s, S);
    const double uu = gains.largest(0, 0);
    result.commands = std::max(result.commands, largest_whole(0, most_missed, [&](int m) {
                                 return gain_of_missed_commands(m) * uu < 1;
                               }));
    if (!positions) continue;
    const double uy = gains.largest(0, 1), yu = gains.largest(1, 0), yy = gains.largest(1, 1);
    const auto stable = [&](int m) {
      const double u = gain_of_missed_commands(m), y = gain_of_missed_measurements(m);
      // The spectral radius of [u uu, u uy; y yu, y yy].
      const double sum = u * uu + y * yy, difference = u * uu - y * yy;
      return sum + std::sqrt(difference * difference + 4 * u * uy * y * yu) < 2;
    };
    result.measurements = std::max(*result.measurements, largest_whole(0, most_missed, stable));
  }
  return result;
}

void find_unstable_pattern(const SampledLoop& loop, double period_s, MissedTicks& result) {
  constexpr int most_hits = 4;
  const HeldMaps maps = held_maps(loop, period_s);
  MatrixXd misses = MatrixXd::Identity(maps.hit.rows(), maps.hit.cols());
  for (int m = 1; m <= std::min(4 * (result.commands + 5), most_missed); ++m) {
    misses = maps.missed * misses;
    if (m <= result.commands) continue;
    MatrixXd pattern = misses;
    for (int hits = 1; hits <= most_hits; ++hits) {
      pattern = maps.hit * pattern;
      if (spectral_radius(pattern) < 1) continue;
      result.unstable = m;
      result.hits = hits;
      return;
    }
  }
}

}  // namespace tachless::linear

#include "linear/frequencies.h"

#include <cmath>
#include <numbers>

namespace tachless::linear {

using Eigen::Index;
using Eigen::VectorXcd;

Eigen::VectorXd balance(Eigen::MatrixXd& map) {
  Eigen::VectorXd scale = Eigen::VectorXd::Ones(map.rows());
  // Scaling an entry makes the norms that it belongs to smaller by a twentieth, and no norm that a
  // cycle of the map has a part in becomes 0: a few passes do. The cap is for rounding alone.
  constexpr int most_passes = 1000;
  bool done = false;
  for (int pass = 0; pass < most_passes && !done; ++pass) {
    done = true;
    for (Index i = 0; i < map.rows(); ++i) {
      const double own = std::abs(map(i, i));
      const double column = map.col(i).cwiseAbs().sum() - own;
      const double row = map.row(i).cwiseAbs().sum() - own;
      if (!(column > 0) || !(row > 0)) continue;
      const double f = std::exp2(std::round(std::log2(row / column) / 2));
      if (column * f + row / f >= 0.95 * (column + row)) continue;
      map.col(i) *= f;
      map.row(i) /= f;
      scale[i] *= f;
      done = false;
    }
  }
  return scale;
}

VectorXcd balanced_eigenvalues(Eigen::MatrixXd map) {
  balance(map);
  return numerics::eigenvalues(map);
}

double spectral_radius(const Eigen::MatrixXd& map) {
  return balanced_eigenvalues(map).cwiseAbs().maxCoeff();
}

FrequencyResponse::FrequencyResponse(const numerics::Schur& A, const Eigen::MatrixXd& B,
                                     const Eigen::MatrixXd& C)
    : T_(A.T.transpose()),
      B_(Eigen::MatrixXd::Zero(2 * B.cols(), B.rows())),
      C_((C * A.U).transpose()) {
  B_.topRows(B.cols()) = (A.U.transpose() * B).transpose();
}

Eigen::MatrixXcd FrequencyResponse::at(const std::complex<double>& z) const {
  const Index states = B_.cols(), inputs = B_.rows() / 2;
  // A column of each state: the real parts of its response to all inputs, then the imaginary parts.
  Eigen::MatrixXd state = B_;
  const auto add_later = [&](Index i, Index later) {
    const Index rest = states - later;
    state.col(i).noalias() += state.rightCols(rest) * T_.col(i).tail(rest);
  };
  const auto part = [&](Index i, Index input) {
    return std::complex(state(input, i), state(inputs + input, i));
  };
  const auto set = [&](Index i, Index input, const std::complex<double>& value) {
    state(input, i) = value.real();
    state(inputs + input, i) = value.imag();
  };
  for (Index i = states - 1; i >= 0; --i) {
    add_later(i, i + 1);
    if (i == 0 || T_(i - 1, i) == 0) {
      const std::complex<double> by = 1.0 / (z - T_(i, i));
      for (Index k = 0; k < inputs; ++k) set(i, k, by * part(i, k));
      continue;
    }
    // Rows j and i of (z - T) are (z - T_jj, -T_ji) and (-T_ij, z - T_ii).
    const Index j = i - 1;
    add_later(j, i + 1);
    const double T_ji = T_(i, j), T_ij = T_(j, i);
    const std::complex<double> at_j = z - T_(j, j), at_i = z - T_(i, i);
    const std::complex<double> by = 1.0 / (at_j * at_i - T_ji * T_ij);
    for (Index k = 0; k < inputs; ++k) {
      const std::complex<double> of_j = by * part(j, k), of_i = by * part(i, k);
      set(j, k, at_i * of_j + T_ji * of_i);
      set(i, k, at_j * of_i + T_ij * of_j);
    }
    --i;
  }
  const Eigen::MatrixXd all = C_.transpose() * state.transpose();
  Eigen::MatrixXcd response(C_.cols(), inputs);
  response.real() = all.leftCols(inputs);
  response.imag() = all.rightCols(inputs);
  return response;
}

std::vector<double> frequencies(const VectorXcd& poles, double period_s, int num_points,
                                const VectorXcd& peaks) {
  const double highest = std::numbers::pi / period_s;
  double slowest = highest;
  for (const auto& p : poles) {
    const double w = std::abs(std::log(p)) / period_s;
    if (w > 0) slowest = std::min(slowest, w);
  }
  const double lowest = std::min(0.1 * slowest, std::max(1e-2 * slowest, 1e-6 * highest));
  const double ratio = std::pow(highest / lowest, 1.0 / num_points);
  std::vector<double> w;
  for (int k = 0; k <= num_points; ++k) w.push_back(lowest * std::pow(ratio, k));
  const auto add = [&](double at) {
    if (at > lowest && at < highest) w.push_back(at);
  };
  for (const auto& p : poles) add(std::arg(p) / period_s);
  for (double beside = 1e-6; beside < 0.01; beside *= 4) {
    for (const auto& p : peaks) {
      add((1 - beside) * std::arg(p) / period_s);
      add((1 + beside) * std::arg(p) / period_s);
    }
  }
  std::ranges::sort(w);
  return w;
}

}  // namespace tachless::linear

#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <complex>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

#include "numerics/decompositions.h"
#include "numerics/golden_section.h"

/// The frequencies at which a sampled loop is evaluated, and the least value over them.
namespace tachless::linear {

/// Balances a one-period map (Parlett and Reinsch, 1969), because Eigen's decompositions do not.
/// The entries of a map differ by factors up to 1e7, because torques and angles are both states. At
/// a short period the eigenvalue of a slow pole may differ from 1 by only 1e-7.
/// @return the diagonal of S; the map has become S^-1 map S
Eigen::VectorXd balance(Eigen::MatrixXd& map);

/// Returns the eigenvalues of a one-period map.
Eigen::VectorXcd balanced_eigenvalues(Eigen::MatrixXd map);
double spectral_radius(const Eigen::MatrixXd& map);

/// The response C (z - A)^-1 B of x' = A x + B u, y = C x over one period. It is computed in the
/// coordinates of the real Schur form. Each frequency costs one back substitution, in which only
/// the blocks of the diagonal are complex.
class FrequencyResponse {
 public:
  FrequencyResponse() = default;
  FrequencyResponse(const numerics::Schur& A, const Eigen::MatrixXd& B, const Eigen::MatrixXd& C);
  [[nodiscard]] Eigen::MatrixXcd at(const std::complex<double>& z) const;

 private:
  Eigen::MatrixXd T_;  ///< transpose of T
  Eigen::MatrixXd B_;  ///< transpose of U' B, with rows of zeros for the imaginary parts
  Eigen::MatrixXd C_;  ///< transpose of C U
};

/// Returns rising frequencies from well below the slowest mode to half the sampling rate, and the
/// frequencies of the closed loop's poles [rad/s]. A resonance may be narrower than any grid.
/// @param peaks poles of the response; the grid is finer near these poles, because the response has
/// no value at a pole without damping
std::vector<double> frequencies(const Eigen::VectorXcd& poles, double period_s, int num_points,
                                const Eigen::VectorXcd& peaks = {});

/// Returns the least f over the frequencies, refined between the neighbours of the lowest minima.
/// Returns NaN where f has no number at any frequency.
template <class F>
double least_over(const std::vector<double>& w, const F& f) {
  constexpr std::size_t refined = 3;
  std::vector<double> value;
  for (const double each : w) value.push_back(f(each));
  std::vector<std::pair<double, std::size_t>> minima;
  for (std::size_t k = 0; k < w.size(); ++k) {
    const bool before = k == 0 || value[k] <= value[k - 1];
    if (before && (k + 1 == w.size() || value[k] <= value[k + 1])) minima.emplace_back(value[k], k);
  }
  if (minima.empty()) return std::numeric_limits<double>::quiet_NaN();
  std::ranges::sort(minima);
  double least = minima.front().first;
  for (std::size_t m = 0; m < std::min(refined, minima.size()); ++m) {
    const std::size_t k = minima[m].second;
    const double at = numerics::largest_between(
        [&](double x) { return -f(x); }, w[k == 0 ? 0 : k - 1], w[std::min(k + 1, w.size() - 1)]);
    least = std::min(least, f(at));
  }
  return least;
}

}  // namespace tachless::linear

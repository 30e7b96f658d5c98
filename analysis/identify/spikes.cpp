#include "identify/spikes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace tachless::identify {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr double spike_deviations = 20;  ///< standard deviations of normal noise
constexpr double spike_motion = 0.01;    ///< share of a joint's motion
constexpr double spike_length = 0.005;   ///< [rad; m]
constexpr double spike_torque = 0.5;     ///< share of the usual range
/// Multiple of the difference between the four rows around. A start beside the reference makes a
/// torque that changes as fast in the rows around.
constexpr double spike_neighbours = 5;

/// Returns the value below which a share of the numbers is.
double value_below(const VectorXd& values, double share) {
  std::vector<double> sorted(values.begin(), values.end());
  const auto at = static_cast<std::ptrdiff_t>(share * static_cast<double>(sorted.size() - 1));
  std::ranges::nth_element(sorted, sorted.begin() + at);
  return sorted[static_cast<std::size_t>(at)];
}

/// Returns the largest difference if it is above `least` and `spike_deviations`.
std::optional<Spike> largest_spike(const VectorXd& off, double least) {
  Index row = 0;
  // Nine of ten numbers of normal noise are within 1.645 standard deviations.
  const double most = off.cwiseAbs().maxCoeff(&row),
               deviation = value_below(off.cwiseAbs(), 0.9) / 1.645;
  if (most <= std::max(spike_deviations * deviation, least)) return {};
  return Spike{row, off[row]};
}

}  // namespace

std::optional<Spike> position_spike(const VectorXd& rows) {
  VectorXd off = VectorXd::Zero(rows.size());
  for (Index k = 2; k + 2 < rows.size(); ++k) {
    off[k] = rows[k] - (4 * (rows[k - 1] + rows[k + 1]) - rows[k - 2] - rows[k + 2]) / 6;
  }
  const double motion = value_below(rows, 0.99) - value_below(rows, 0.01);
  const std::optional<Spike> found =
      largest_spike(off, std::max(spike_motion * motion, spike_length));
  // The largest difference beside the ends may be that of a neighbour that has none.
  if (!found || found->row < 4 || found->row + 4 >= rows.size()) return {};
  return found;
}

std::optional<Spike> torque_spike(const VectorXd& rows) {
  VectorXd off = VectorXd::Zero(rows.size());
  for (Index k = 2; k + 2 < rows.size(); ++k) {
    std::array<double, 5> around = {rows[k - 2], rows[k - 1], rows[k], rows[k + 1], rows[k + 2]};
    std::ranges::nth_element(around, around.begin() + 2);
    const auto [least, most] = std::minmax({rows[k - 2], rows[k - 1], rows[k + 1], rows[k + 2]});
    const double difference = rows[k] - around[2];
    if (std::abs(difference) > spike_neighbours * (most - least)) off[k] = difference;
  }
  return largest_spike(off, spike_torque * (value_below(rows, 0.99) - value_below(rows, 0.01)));
}

}  // namespace tachless::identify

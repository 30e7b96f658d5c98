#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>

#include "messages/signals.h"

/// Checks of the properties that every trajectory must have.
namespace tachless::reference::trajectory {

inline std::array<Vector, 5> orders(const messages::ReferencePoint& p) {
  return {p.q_ref, p.v_ref, p.a_ref, p.jerk_ref, p.snap_ref};
}

/// Compares velocity, acceleration, jerk and snap at t with the eighth-order central difference of
/// the next lower order. `truncation[k]` bounds the difference formula's own error: step^8 / 630
/// times the ninth derivative of order k. Rounding of the samples costs about eps / step.
template <class Shape>
void expect_derivatives_of_each_other(const Shape& shape, double t, double step,
                                      const std::array<double, 4>& truncation) {
  constexpr std::array<double, 4> weight{4.0 / 5, -1.0 / 5, 4.0 / 105, -1.0 / 280};
  const auto here = orders(shape.at(t));
  std::array<Vector, 4> difference;
  std::array<double, 4> size{};
  for (int k = 0; k < 4; ++k) {
    difference[k] = Vector::Zero(here[k].size());
  }
  for (int j = 1; j <= 4; ++j) {
    const auto after = orders(shape.at(t + j * step));
    const auto before = orders(shape.at(t - j * step));
    for (int k = 0; k < 4; ++k) {
      difference[k] += weight[j - 1] / step * (after[k] - before[k]);
      size[k] = std::max({size[k], after[k].template lpNorm<Eigen::Infinity>(),
                          before[k].template lpNorm<Eigen::Infinity>()});
    }
  }
  for (int k = 0; k < 4; ++k) {
    // A sample is a sum of up to ten rounded terms, its time is rounded too.
    const double rounding = 100 * std::numeric_limits<double>::epsilon() * (1 + size[k]) / step;
    EXPECT_LE((difference[k] - here[k + 1]).template lpNorm<Eigen::Infinity>(),
              rounding + truncation[k])
        << "derivative " << k + 1 << " at t = " << t;
  }
}

inline void expect_at_rest(const messages::ReferencePoint& p, double tolerance) {
  EXPECT_LE(p.v_ref.lpNorm<Eigen::Infinity>(), tolerance);
  EXPECT_LE(p.a_ref.lpNorm<Eigen::Infinity>(), tolerance);
  EXPECT_LE(p.jerk_ref.lpNorm<Eigen::Infinity>(), tolerance);
  EXPECT_LE(p.snap_ref.lpNorm<Eigen::Infinity>(), tolerance);
}

}  // namespace tachless::reference::trajectory

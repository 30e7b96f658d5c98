#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>

#include "messages/signals.h"
#include "tests/controller/law/two_link.h"

namespace tachless::controller::law {

/// The paper's reference, 5 Hz with velocities of 1 rad/s.
inline messages::ReferencePoint paper_reference(double t) {
  constexpr double w = 2 * std::numbers::pi * 5;
  const double s = std::sin(w * t), c = std::cos(w * t);
  const auto both = [](double x) { return vector(x, x); };
  return {both(s / w), both(c), both(-w * s), both(-w * w * c), both(w * w * w * s)};
}

/// Width of a count of a 16-bit encoder [rad].
inline constexpr double count_16_bit = 2 * std::numbers::pi / 65536;

/// Returns the RMS error [rad/s] of an estimator alone, over 2 s of the paper's reference after 0.4
/// s. A 16-bit encoder reads the position every millisecond.
template <class Estimator>
double velocity_error(const Estimator& estimator) {
  constexpr double h = 1e-3;
  constexpr int settled = 400, ticks = 2400;
  const auto read = [&](int k) -> Vector {
    return (paper_reference(k * h).q_ref / count_16_bit).array().round() * count_16_bit;
  };
  auto memory = estimator.start(read(0), paper_reference(0));
  double sum = 0;
  for (int k = 0; k < ticks; ++k) {
    memory = estimator.step(memory, read(k));
    const double error = estimator.velocity(memory)[0] - paper_reference(k * h).v_ref[0];
    if (k >= settled) sum += error * error;
  }
  return std::sqrt(sum / (ticks - settled));
}

}  // namespace tachless::controller::law

#pragma once

#include <array>
#include <vector>

#include "loop/signals.h"

namespace tachless::reference::trajectory {

/// A C4 spline through positions at given times, at rest through snap at both ends. Inner pieces
/// are quintic; the first and the last are of degree 7, which is what the extra end conditions
/// cost (two points only: degree 9). Before the first time it holds the first position, after the
/// last the last, so it is C4 everywhere.
class Waypoints {
 public:
  /// Solves for the spline. `time_s` strictly increasing, one position per time, at least two,
  /// positions all of one length [rad; m if prismatic].
  /// @throw std::invalid_argument, one line naming the times that are not in order, or the lengths.
  Waypoints(std::vector<double> time_s, const std::vector<robot::Vector>& position);

  /// Position to snap at t [s], each differentiated in closed form.
  [[nodiscard]] loop::ReferencePoint at(double t_s) const;

 private:
  static constexpr int max_coefficients = 10;

  /// Coefficients of x^k, x = (t - t_i) / T or, in a mirrored piece, (t_{i+1} - t) / T.
  struct Piece {
    double duration_s = 0;
    bool mirrored = false;
    std::array<robot::Vector, max_coefficients> c;
    int num_coefficients = 0;
  };

  std::vector<double> time_s_;
  robot::Vector first_, last_;
  std::vector<Piece> pieces_;
};

}  // namespace tachless::reference::trajectory

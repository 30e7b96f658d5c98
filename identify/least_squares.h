#pragma once

#include <Eigen/Core>
#include <vector>

#include "identify/parameters.h"
#include "identify/recording.h"

namespace tachless::identify {

/// The inverse dynamics of recordings, linear in the parameters, with both sides through the same
/// filter: position and torque through a low-pass without phase, velocity and acceleration by
/// differences of the filtered position. A row per joint and instant.
struct Regression {
  Eigen::MatrixXd columns;  ///< torque per parameter
  Eigen::VectorXd torque;   ///< [N m; N] beyond what the robot takes whose unknowns are all zero
  Eigen::VectorXi joint;    ///< of the row
  Eigen::VectorXd peak;     ///< largest filtered torque of each joint [N m; N]

  /// Root mean square of what `values` leave of the torque, per joint [N m; N].
  [[nodiscard]] Eigen::VectorXd residual(const Eigen::VectorXd& values) const;
};

Regression regression(const Recording& recording, const Parameters& parameters);

/// Weighted by each joint's residual, none below zero. The errors of the filtered signs of the
/// velocity bias it: a start for `output_error`, not an answer.
Eigen::VectorXd least_squares(const std::vector<Regression>& of);

}  // namespace tachless::identify

#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "identify/output_error.h"

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

/// Columns through that low-pass (15 Hz). @param h their period [s]
Eigen::MatrixXd low_passed(Eigen::MatrixXd columns, double h);

/// Weighted by each joint's residual; friction, rotors and payload not below zero, links as they
/// can be (inertia.h). The errors of the filtered signs of the velocity bias it: a start for
/// `output_error`, and an answer only where no loop can be simulated.
struct LeastSquares : Precision {  ///< widths infinite where not determined
  Eigen::VectorXd values;
  std::vector<std::string> sums;  ///< of what a parameter is determined with only; empty: alone
};
LeastSquares least_squares(const std::vector<Regression>& of, const Parameters& parameters,
                           const robot::Model& model);

}  // namespace tachless::identify

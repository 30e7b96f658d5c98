#pragma once

#include <Eigen/Core>
#include <string>
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
  Eigen::VectorXd applied;  ///< [N m; N] all of it
  Eigen::VectorXd time_s;   ///< of the row, from the recording's start
  Eigen::VectorXi joint;    ///< likewise
  Eigen::VectorXd peak;     ///< largest filtered torque of each joint [N m; N]
  Eigen::VectorXd share;    ///< of each parameter: largest torque of a unit, at any tick, over peak

  /// Root mean square of what `values` leave of the torque, per joint [N m; N].
  [[nodiscard]] Eigen::VectorXd residual(const Eigen::VectorXd& values) const;
};

Regression regression(const Recording& recording, const Parameters& parameters);

/// Columns through that low-pass (15 Hz). @param h their period [s]
Eigen::MatrixXd low_passed(Eigen::MatrixXd columns, double h);

/// How well a least-squares estimate is determined.
struct Precision {
  Eigen::VectorXd half_width;  ///< of the 95 % intervals
  Eigen::Index rank = 0;       ///< combinations that are determined: eigenvalues above 1e-9
  double condition = 0;        ///< of these: square root of the eigenvalues' ratio
  Eigen::MatrixXd free;        ///< projector onto the others
};
/// From the Jacobian, its columns' norms, by which it is scaled, and the residual in order of time:
/// what the estimate varies by when blocks of time are left out, whatever the residual's colour.
Precision precision(const Eigen::MatrixXd& J, const Eigen::VectorXd& norm,
                    const Eigen::VectorXd& residual);

/// Weighted by each joint's residual; friction, rotors and payload not below zero, links as they
/// can be (inertia.h). The errors of the filtered signs of the velocity bias it: a start for
/// `output_error`, and an answer only where no loop can be simulated. As a `start` without joints
/// at rest, whose friction is any up to Coulomb's.
struct LeastSquares : Precision {  ///< widths infinite where not determined
  Eigen::VectorXd values;
  std::vector<std::string> sums;  ///< of what a parameter is determined with only; empty: alone
};
LeastSquares least_squares(const std::vector<Regression>& of, const Parameters& parameters,
                           const robot::Model& model, bool start = false);

}  // namespace tachless::identify

#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "identify/parameters.h"
#include "identify/recording.h"

namespace tachless::identify {

/// The inverse dynamics of a recording, linear in the parameters, with one row per joint and
/// instant. Both sides pass the same filter: a low-pass without phase. Velocity and acceleration
/// are differences of the filtered position.
struct Regression {
  Eigen::MatrixXd columns;  ///< torque per parameter
  Eigen::VectorXd torque;   ///< torque beyond that of the robot with all unknowns zero [N m; N]
  /// Largest deviation of `torque` because a table does not tell whether its torques are those of
  /// instants or means over two rows [N m; N]; zero for the recording of a loop.
  Eigen::VectorXd unsure;
  Eigen::VectorXd applied;  ///< whole torque [N m; N]
  Eigen::VectorXd time_s;   ///< time of the row from the recording's start
  Eigen::VectorXi joint;    ///< joint of the row
  Eigen::VectorXd speed;    ///< filtered velocity of that joint [rad/s; m/s]
  /// True if that joint is slower than a fifth of its largest speed at some time within 0.1 s of
  /// the row. The time is shorter for a joint that would keep less than a fifth of its rows.
  std::vector<bool> slow;
  Eigen::VectorXd peak;   ///< largest filtered torque of each joint [N m; N]
  Eigen::VectorXd share;  ///< largest torque of one unit of each parameter at any tick, over `peak`

  /// Returns the rms of the torque that `values` leave unexplained, per joint [N m; N].
  /// @param with_slow whether a joint's slow rows count; empty: all rows do
  [[nodiscard]] Eigen::VectorXd residual(const Eigen::VectorXd& values,
                                         const std::vector<bool>& with_slow = {}) const;
  /// Returns whether a row is used, if slow rows are used for the joints in `with_slow`.
  [[nodiscard]] bool used(Eigen::Index row, const std::vector<bool>& with_slow) const {
    const auto at = static_cast<std::size_t>(row);
    return !slow[at] || with_slow[static_cast<std::size_t>(joint[row])];
  }
};

/// Returns the regression of a recording.
Regression regression(const Recording& recording, const Parameters& parameters);

/// Returns the number of successive filtered rows that count as one independent row.
double rows_alike(const Regression& regression);

/// Filters each column with the low-pass of `regression`.
/// @param h period of the rows [s]
Eigen::MatrixXd low_passed(Eigen::MatrixXd columns, double h, double cutoff_hz = 15);

/// The precision of a least-squares estimate.
struct Precision {
  Eigen::VectorXd half_width;  ///< half widths of the 95 % intervals
  /// Number of determined combinations: eigenvalues above 1e-9 of the largest.
  Eigen::Index rank = 0;
  /// Square root of the ratio of the largest to the least determined eigenvalue.
  double condition = 0;
  Eigen::MatrixXd free;  ///< projector onto the undetermined combinations
  /// Changes of the parameters when each block of time is left out, a column per block.
  Eigen::MatrixXd moves;
  /// Changes of the parameters by `Regression::unsure`, which `half_width` contains; empty: none.
  Eigen::VectorXd unsure;

  /// Returns the half width of a combination of the parameters. Its degrees of freedom are the
  /// fewest of the parameters in it.
  [[nodiscard]] double half_width_of(const Eigen::VectorXd& combination) const;
};
/// Computes the precision from the variation of the estimate when blocks of time are left out. It
/// holds for residuals of any autocorrelation. A parameter at its bound is held there for the
/// precision of the others. The half width of that parameter comes from an estimate in which it
/// alone may leave its bound. The true value is then at most a half width from the bound.
/// @param J Jacobian, rows in order of time
/// @param norm norms of its columns, by which it is scaled
/// @param residual in order of time
/// @param at_bound parameters that are at their bound; empty: none is
Precision precision(const Eigen::MatrixXd& J, const Eigen::VectorXd& norm,
                    const Eigen::VectorXd& residual, const std::vector<bool>& at_bound = {});

/// Returns which values are at the bound that `possible_values` keeps.
std::vector<bool> at_bound(const Parameters& parameters, const Eigen::VectorXd& values);

/// Weighted least squares: the weight of a joint is the reciprocal of its residual. Friction,
/// rotors and payload are not negative, and links are physically possible (physical_inertia.h).
/// Slow rows bias the result for two reasons. The filtered velocity may have the wrong sign there,
/// and a joint at rest may have any friction up to Coulomb's.
struct LeastSquares : Precision {  ///< half widths are infinite where not determined
  Eigen::VectorXd values;
  /// For each parameter that is determined only in a sum: the other parameters of the sum. Empty:
  /// the parameter is determined by itself.
  std::vector<std::string> sums;
};
/// @param with_slow whether a joint's slow rows are used; empty: no joint's are
LeastSquares least_squares(const std::vector<Regression>& regressions, const Parameters& parameters,
                           const robot::Model& model, const std::vector<bool>& with_slow = {});

}  // namespace tachless::identify

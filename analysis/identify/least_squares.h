#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "identify/parameters.h"
#include "identify/recording.h"

namespace tachless::identify {

/// Rows of a joint that are used. `fast`: rows that are not slow. `one_way`: rows that are not near
/// a reversal, slow ones too. `all`: every row.
enum class RowUse { fast, one_way, all };

/// The inverse dynamics of a recording, linear in the parameters, with one row per joint and
/// instant. Both sides pass the same filter: a low-pass without phase. Velocity and acceleration
/// are differences of the filtered position.
struct Regression {
  Eigen::MatrixXd columns;  ///< torque per parameter
  Eigen::MatrixXd turns;    ///< derivatives of the columns of rises by their v_r, if unknown
  Eigen::VectorXd torque;   ///< torque beyond that of the robot with all unknowns zero [N m; N]
  /// Largest deviations of `torque` [N m; N], one of each column. The first one is there because a
  /// table does not tell whether its torques are those of instants or means over two rows. It is
  /// zero for the recording of a loop. The second one is that of `Recording::own_late`.
  Eigen::MatrixXd unsure;
  Eigen::VectorXd applied;  ///< whole torque [N m; N]
  Eigen::VectorXd time_s;   ///< time of the row from the recording's start
  Eigen::VectorXi joint;    ///< joint of the row
  Eigen::VectorXd speed;    ///< filtered velocity of that joint [rad/s; m/s]
  /// True if that joint is slower than a fifth of its largest speed at some time within 0.1 s of
  /// the row. The time is shorter for a joint that would keep less than a fifth of its rows.
  std::vector<bool> slow;
  /// True if that joint creeps, below 2 % of its largest speed, or reverses within 0.1 s of the
  /// row. The filtered velocity may have the wrong sign there.
  std::vector<bool> reversing;
  Eigen::VectorXd peak;   ///< largest filtered torque of each joint [N m; N]
  Eigen::VectorXd share;  ///< largest torque of one unit of each parameter at any tick, over `peak`

  /// Returns the rms of the torque that `values` leave unexplained, per joint [N m; N].
  /// @param rows of each joint that count; empty: all do
  [[nodiscard]] Eigen::VectorXd residual(const Eigen::VectorXd& values,
                                         const std::vector<RowUse>& rows = {}) const;
  /// Returns the rms of `x`, one number per row, over the rows of each joint.
  /// @param rows of each joint that count; empty: all do
  [[nodiscard]] Eigen::VectorXd rms(const Eigen::VectorXd& x,
                                    const std::vector<RowUse>& rows = {}) const;
  /// Returns whether a row is one of those of its joint.
  [[nodiscard]] bool used(Eigen::Index row, const std::vector<RowUse>& rows) const {
    const auto at = static_cast<std::size_t>(row);
    const RowUse of_joint = rows[static_cast<std::size_t>(joint[row])];
    return of_joint == RowUse::all || !(of_joint == RowUse::fast ? slow : reversing)[at];
  }
};

/// Returns the regression of a recording.
Regression regression(const Recording& recording, const Parameters& parameters);

/// Returns the number of successive filtered rows that count as one independent row.
double rows_alike(const Regression& regression);

/// Filters each column with the low-pass of `regression`.
/// @param h period of the rows [s]
Eigen::MatrixXd low_passed(Eigen::MatrixXd columns, double h, double cutoff_hz = 15);

/// Knowledge of the parameters besides the residual: `rows` times their error are independent
/// numbers of standard deviation 1 (`possible_values`).
struct Prior {
  Eigen::MatrixXd rows;
  double alike = 1;  ///< number of successive rows of the Jacobian that count as one (`rows_alike`)
};

/// The precision of a least-squares estimate.
struct Precision {
  Eigen::VectorXd half_width;  ///< half widths of the 95 % intervals
  /// Number of combinations that the residual determines: eigenvalues above 1e-9 of the largest.
  Eigen::Index rank = 0;
  /// Square root of the ratio of the largest to the least determined eigenvalue.
  double condition = 0;
  Eigen::MatrixXd free;  ///< projector onto the combinations that the residual does not determine
  /// Changes of the parameters when each window of time is left out, a column per window, and after
  /// them their changes by a standard deviation of each number of the prior. The squares' sum has
  /// no bias for white residuals.
  Eigen::MatrixXd moves;
  /// True of parameters whose standard deviation would be more than twice as large without the
  /// prior.
  std::vector<bool> by_prior;
  /// Changes of the parameters by deviations of the data such as `Regression::unsure`, a column for
  /// each. `half_width` contains them.
  Eigen::MatrixXd unsure;

  /// Returns the half width of a combination of the parameters. Its degrees of freedom are the
  /// fewest of the parameters in it.
  [[nodiscard]] double half_width_of(const Eigen::VectorXd& combination) const;
};
/// Computes the precision from the variation of the estimate when windows of time are left out. It
/// holds for residuals of any autocorrelation. A parameter at its bound is held there for the
/// precision of the others. The half width of that parameter comes from an estimate in which it
/// alone may leave its bound. The true value is then at most a half width from the bound.
/// @param J Jacobian, rows in order of time
/// @param residual in order of time
/// @param at_bound parameters that are at their bound; empty: none is
/// @param prior that the estimate used; no rows: none
/// @param unsure deviations of the rows, a column for each, which widen the intervals; empty: none
Precision precision(const Eigen::MatrixXd& J, const Eigen::VectorXd& residual,
                    const std::vector<bool>& at_bound = {}, const Prior& prior = {},
                    const Eigen::MatrixXd& unsure = {});

/// Computes the precision of the first `size` parameters. J has columns of further unknowns after
/// theirs, which are free and of which the prior tells nothing.
Precision precision_of_first(Eigen::Index size, const Eigen::MatrixXd& J,
                             const Eigen::VectorXd& residual, std::vector<bool> at_bound,
                             const Prior& prior, const Eigen::MatrixXd& unsure = {});

/// Least squares without weights, bounds or a prior.
struct Fitted : Precision {
  Eigen::VectorXd values;
};
/// Fits the columns of J to y.
Fitted fitted(const Eigen::MatrixXd& J, const Eigen::VectorXd& y);

/// Returns which values are at the bound that `possible_values` keeps.
std::vector<bool> at_bound(const Parameters& parameters, const Eigen::VectorXd& values);

/// Weighted least squares: the weight of a joint is the reciprocal of its residual. Friction,
/// rotors and payload are not negative, and links are physically possible (physical_inertia.h).
/// Slow rows bias the result for two reasons. The filtered velocity may have the wrong sign there,
/// and a joint at rest may have any friction up to Coulomb's.
struct LeastSquares : Precision {  ///< half widths are infinite where not determined
  Eigen::VectorXd values;
  /// Change of each unknown v_r that lowers the residual, times the rise. The intervals contain
  /// that v_r is unknown.
  Eigen::VectorXd turns;
  /// For each parameter that is determined only in a sum: the other parameters of the sum. Empty:
  /// the parameter is determined by itself.
  std::vector<std::string> sums;
};
/// @param rows that are used of each joint; empty: the fast ones
LeastSquares least_squares(const std::vector<Regression>& regressions, const Parameters& parameters,
                           const robot::Model& model, const std::vector<RowUse>& rows = {});

}  // namespace tachless::identify

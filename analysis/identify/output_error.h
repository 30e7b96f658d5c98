#pragma once

#include <Eigen/Core>
#include <functional>
#include <string_view>
#include <vector>

#include "identify/least_squares.h"
#include "identify/parameters.h"
#include "identify/recording.h"

namespace tachless::identify {

/// The parameters with which the simulated loop reproduces the measured positions. The simulation
/// runs the recorded law's own code.
struct Fit : Precision {
  Eigen::VectorXd values;
  Eigen::VectorXd velocities;  ///< v_r of the rises of which it is unknown
  Eigen::VectorXd residual;    ///< rms of measured minus simulated position, per joint [rad; m]
  /// Encoder noise of each recording, for `simulated_residual`.
  std::vector<Eigen::MatrixXd> noise;
  /// The linear problem at the answer, in the rows of `rows_of_fit`: derivatives of the residual by
  /// the values and then by the velocities, and the residual.
  Eigen::MatrixXd J;
  Eigen::VectorXd r;
};

using Report = std::function<void(std::string_view what)>;

/// Fits the parameters by Gauss-Newton on measured minus simulated positions. The weight of a joint
/// is the reciprocal of its residual. The parameters stay physically possible (physical_inertia.h).
/// In the first passes the simulated law reads the simulated positions plus the part of the last
/// residual above 50 Hz. This part is the noise of the recorded encoders. Such noise moves the arm
/// and thereby lowers its dry friction. The v_r of rises that are unknown are fitted too, and the
/// intervals contain that. Derivatives are differences of simulations. Further passes use them
/// again. They are computed anew when the steps do not fall by a factor of four, and at the end if
/// the values are far from those of the derivatives. The intervals hold for residuals of any
/// autocorrelation (`precision`). Without convergence they are wider by the remaining step.
/// @throw base::Failure(check_said_no) when the loop cannot be simulated at `start`
Fit output_error(const std::vector<Recording>& recordings, const Parameters& parameters,
                 const Eigen::VectorXd& start, const Report& report);

/// Returns measured minus simulated positions of all recordings over `fit.residual`, tick by tick
/// and joint by joint, at every few ticks. They are `fit.r` if a simulated run ends early.
Eigen::VectorXd rows_of_fit(const std::vector<Recording>& recordings, const Parameters& parameters,
                            const Eigen::VectorXd& values, const Fit& fit);

/// Returns measured minus simulated positions [rad; m], one row per tick. There are fewer rows if
/// the simulated run ends early.
/// @param noise added to the positions that the simulated law reads, a row per tick; empty: none
Eigen::MatrixXd simulated_residual(const Recording& recording, const Parameters& parameters,
                                   const Eigen::VectorXd& values,
                                   const Eigen::MatrixXd& noise = {});

}  // namespace tachless::identify

#pragma once

#include <Eigen/Core>
#include <functional>
#include <string_view>
#include <vector>

#include "identify/least_squares.h"
#include "identify/parameters.h"
#include "identify/recording.h"

namespace tachless::identify {

/// The parameters with which the loop, simulated with the recorded law's own code, measures what
/// was measured.
struct Fit {
  Eigen::VectorXd values;
  Eigen::VectorXd half_width;  ///< of the 95 % interval of each
  double condition = 0;        ///< of the scaled normal matrix
  Eigen::VectorXd residual;    ///< rms of measured minus simulated position, per joint [rad; m]
};

using Report = std::function<void(std::string_view what)>;

/// Gauss-Newton on measured minus simulated positions, joints weighted by their residual, from
/// `start`, to what a robot can have (inertia.h); the derivatives are differences of simulations.
/// The intervals hold for residuals of any colour (`precision`); where it has not converged they
/// are wider by the step that is left.
/// @throw base::Failure(check_said_no) when the loop cannot be simulated at `start`
Fit output_error(const std::vector<Recording>& recordings, const Parameters& parameters,
                 const Eigen::VectorXd& start, const Report& report);

/// Measured minus simulated positions [rad; m], a row per tick; fewer rows where the simulated run
/// ended early.
Eigen::MatrixXd simulated_residual(const Recording& recording, const Parameters& parameters,
                                   const Eigen::VectorXd& values);

}  // namespace tachless::identify

#pragma once

#include <Eigen/Core>
#include <vector>

#include "identify/friction_terms.h"
#include "identify/output_error.h"

namespace tachless::identify {

/// Least gain of a term in a simulated loop, as a share of one joint's error in blocks of time that
/// were not fitted. The encoder's counts and noise may be most of that error. In white residuals of
/// 5000 ticks a term of so small a gain is five standard deviations from zero.
constexpr double least_loop_gain = 0.003;

/// Further terms of friction, and values of all parameters with them from which a fit can start.
struct LoopTerms {
  std::vector<FrictionTerm> terms;  ///< new ones
  Eigen::VectorXd start;            ///< the parameters' values, and then the new terms'
};

/// Chooses the terms of friction, beyond those among the parameters, that the logs of simulated
/// loops ask for at some joints. Each candidate is simulated with a small factor, which gives its
/// column of the linear problem at the answer. One after the other, the candidate is taken that
/// lowers the error in ten blocks of time, each left out of the fit, the most, if it does by
/// `least_loop_gain`. The friction must take energy at every speed.
/// @param regressions one of each recording
/// @param fit the answer for `parameters`
/// @param kinds of the parameters
/// @param terms among the parameters, with the v_r of the answer
/// @param joints at which the model may lack something
LoopTerms loop_terms(const std::vector<Recording>& recordings,
                     const std::vector<Regression>& regressions, const Fit& fit,
                     const std::vector<Kind>& kinds, const std::vector<FrictionTerm>& terms,
                     const std::vector<int>& joints);

/// Returns each joint's rms of measured minus simulated positions in ten blocks of time, each left
/// out of a linear fit at the answer [rad; m].
Eigen::VectorXd held_out_error(const Fit& fit);

}  // namespace tachless::identify

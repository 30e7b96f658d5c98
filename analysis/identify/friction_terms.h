#pragma once

#include <Eigen/Core>
#include <vector>

#include "identify/least_squares.h"
#include "identify/misfit.h"
#include "identify/recording.h"

namespace tachless::identify {

/// Chooses the terms of friction, beyond viscous and Coulomb friction, that tables ask for. Only
/// joints with a misfit are examined. A term is chosen if it lowers the torque error in blocks of
/// time that were not fitted by 2 %, its 95 % interval excludes zero, and the friction takes energy
/// at every speed. The velocity v_r of a rise is the one with the least such error.
/// @param kinds unknown parameters; `viscous` and `coulomb` must be among them
/// @param regressions one of each recording, for `parameters`
/// @param values least squares of `parameters`
std::vector<FrictionTerm> friction_terms(const std::vector<Recording>& recordings,
                                         const std::vector<Kind>& kinds,
                                         const std::vector<Regression>& regressions,
                                         const Parameters& parameters,
                                         const Eigen::VectorXd& values,
                                         const std::vector<Misfit>& misfits);

/// Returns the terms whose intervals exclude zero and whose friction takes energy.
std::vector<FrictionTerm> kept_terms(const std::vector<FrictionTerm>& terms,
                                     const Parameters& parameters, const LeastSquares& found);

}  // namespace tachless::identify

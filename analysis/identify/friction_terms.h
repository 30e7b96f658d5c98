#pragma once

#include <Eigen/Core>
#include <vector>

#include "identify/least_squares.h"
#include "identify/recording.h"

namespace tachless::identify {

/// Chooses the terms of friction, beyond viscous and Coulomb friction, that recordings ask for, at
/// most one rise and one load friction of a joint. Rows near a reversal are left out, because the
/// filtered velocity may have the wrong sign there. A term is chosen if it lowers the torque error
/// in blocks of time that were not fitted, its 95 % interval excludes zero by far, and the friction
/// takes energy at every speed. The velocity v_r of a rise is the one with the least such error.
/// @param regressions one of each recording, for `parameters`
/// @param parameters `viscous` and `coulomb` must be among them
/// @param values the answer for `parameters`
std::vector<FrictionTerm> friction_terms(const std::vector<Recording>& recordings,
                                         const std::vector<Regression>& regressions,
                                         const Parameters& parameters,
                                         const Eigen::VectorXd& values);

/// Returns true if friction with a further term takes energy at every speed.
/// @param value F_r of a rise [N m; N], or the factor of friction by the load
/// @param coulomb friction of the same joint [N m; N]
bool takes_energy(Kind kind, double value, double coulomb);

/// Returns the largest filtered speed of a joint [rad/s; m/s].
double largest_speed(const std::vector<Regression>& regressions, int joint);

/// Returns the terms that their intervals tell clearly from zero and whose friction takes energy.
std::vector<FrictionTerm> kept_terms(const std::vector<FrictionTerm>& terms,
                                     const Parameters& parameters, const LeastSquares& found);

}  // namespace tachless::identify

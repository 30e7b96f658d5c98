#pragma once

#include <Eigen/Core>
#include <functional>
#include <stdexcept>

#include "linear/linear_loop.h"

/// The linear model of a law whose code is not here, from what it answers to small deviations of
/// what it measures.
namespace tachless::linear {

/// From deviations [inputs x ticks] of the measurement from one at which the law is at rest, the
/// first tick that of a run which begins, to torques [joints x ticks].
using Ask = std::function<Eigen::MatrixXd(const Eigen::MatrixXd& deviations)>;

/// Why there is no such model: the message is one clause.
struct NoLinearModel : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Ticks of a pulse's answer that a model is made of, the fewest first: of that many, models of up
/// to half as many states for each input.
inline constexpr Eigen::Index windows[] = {24, 96, 288};
/// Ticks over which a model of the first posture has to foretell answers.
inline constexpr Eigen::Index foretold = 1200;

/// The law's state-space model without its measured parts: of the answers to a pulse in each input
/// by a singular value decomposition of their Hankel matrix (Ho and Kalman 1966; Juang and Pappa,
/// "An eigensystem realization algorithm", J. Guidance 8(5), 1985), of the order that the rounding
/// in each joint lets through. What is small enough to be linear: 1e-6 rad. It is made of what is
/// odd in the deviations; of answers to ten times that, to random pulses in all inputs at once and
/// then to a step, what is odd has to be as the model foretells, to 1e-4, and of what is even no
/// more than that may be proportional to them: the rest is quadratic, as that of gravity.
/// @param window one of `windows`  @param ticks for which it foretells
/// @throw NoLinearModel when its answers do not superpose, or are of no system of so few states
LinearLaw realised(const Ask& ask, Eigen::Index inputs, Eigen::Index window, Eigen::Index ticks);

/// Torque per deviation in its tick [joints x inputs]: D of that model.
Eigen::MatrixXd at_once(const Ask& ask, Eigen::Index inputs);

/// The first of `windows` with which `realised` foretells `foretold` ticks.
/// @throw NoLinearModel as there, and when the law does not answer the same twice
Eigen::Index window_of(const Ask& ask, Eigen::Index inputs);

}  // namespace tachless::linear

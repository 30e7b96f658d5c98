#pragma once

#include <Eigen/Core>
#include <functional>
#include <stdexcept>

#include "linear/linear_loop.h"

/// A linear model of a law whose code this program does not have. It is made of the law's answers
/// to small deviations of its measurement.
namespace tachless::linear {

/// Function that returns torques [joints x ticks] for deviations of the measurement [inputs x
/// ticks]. The deviations are from a measurement at which the law is at rest. The first tick begins
/// a run.
using Ask = std::function<Eigen::MatrixXd(const Eigen::MatrixXd& deviations)>;

/// Error of a law that has no linear model; the message is one clause that gives the reason.
struct NoLinearModel : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Numbers of ticks of a pulse's answer from which a model is made, the fewest first. A model has
/// up to half as many states for each input.
inline constexpr Eigen::Index windows[] = {24, 96, 288};
/// Number of ticks over which a model of the first posture has to predict the law's answers.
inline constexpr Eigen::Index foretold = 1200;

/// Returns the law's state-space model; its `measured` is left empty. A singular value
/// decomposition of the Hankel matrix of the answers to a pulse in each input gives the model (Ho
/// and Kalman 1966; Juang and Pappa, "An eigensystem realization algorithm", J. Guidance 8(5),
/// 1985). The order is the number of singular values above the rounding in each joint. Pulses of
/// 1e-6 rad are small enough to be linear.
///
/// The model is made of the odd part of the answers. Other answers check it: to ten times the
/// deviations, to random pulses in all inputs at once, and to a step. Their odd part has to match
/// the model within 1e-4. Their even part has to be zero or quadratic in the deviations, within the
/// same tolerance. Gravity makes the even part quadratic.
/// @param window one of `windows`
/// @param ticks number of ticks that the model has to predict
/// @throw NoLinearModel when the answers do not superpose, or need more states than the window
/// gives
LinearLaw realised(const Ask& ask, Eigen::Index inputs, Eigen::Index window, Eigen::Index ticks);

/// Returns the torque per deviation in the same tick [joints x inputs], the matrix D of the model.
Eigen::MatrixXd at_once(const Ask& ask, Eigen::Index inputs);

/// Returns the first of `windows` with which `realised` predicts `foretold` ticks.
/// @throw NoLinearModel as `realised`, and when two equal requests have different answers
Eigen::Index window_of(const Ask& ask, Eigen::Index inputs);

}  // namespace tachless::linear

#pragma once

#include <Eigen/Core>
#include <optional>

#include "linear/sampled_limit.h"

/// The covariance that white noise of the encoders gives a linear loop.
namespace tachless::linear {

/// Returns the standard deviation of each joint's position error [rad; m] in the closed loop that
/// noise of the encoders drives. It solves P = F P F' + G R G' by doubling, with the map F of one
/// period. Returns nothing for an unstable loop, which has no such P.
/// @param noise standard deviation of each entry of the measurement
std::optional<Eigen::VectorXd> error_by_noise(const SampledLoop& loop, double period_s,
                                              const Eigen::VectorXd& noise);

}  // namespace tachless::linear

#pragma once

#include <Eigen/Core>
#include <optional>

#include "linear/sampled_limit.h"

/// Covariance of a linear loop that white noise of the encoders drives.
namespace tachless::linear {

/// Returns the standard deviation of each joint's position error [rad; m] in the closed loop that
/// noise of the encoders drives. The covariance P of the state solves P = F P F' + G R G'. F is the
/// map of one period, G the map of the noise, and R the noise's covariance. The equation is solved
/// by doubling. Returns nothing for an unstable loop, which has no such P.
/// @param noise standard deviation of each entry of the measurement, in that entry's unit
std::optional<Eigen::VectorXd> error_by_noise(const SampledLoop& loop, double period_s,
                                              const Eigen::VectorXd& noise);

}  // namespace tachless::linear

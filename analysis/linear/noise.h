#pragma once

#include <Eigen/Core>
#include <optional>

#include "linear/sampled_limit.h"

/// The covariance that white noise of the encoders gives a linear loop.
namespace tachless::linear {

/// Returns the standard deviation of each joint's position error [rad; m] in the closed loop that
/// noise of these standard deviations drives, one for each entry of the measurement.
/// It solves P = F P F' + G R G' by doubling, with the map F of one period. An unstable loop has no
/// such P: nothing.
std::optional<Eigen::VectorXd> error_by_noise(const SampledLoop& loop, double period_s,
                                              const Eigen::VectorXd& noise);

}  // namespace tachless::linear

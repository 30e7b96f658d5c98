#pragma once

#include <Eigen/Core>
#include <string>

#include "identify/recording.h"

namespace tachless::identify {

/// Returns a correction with which a table fits the robot, as keys of the table's description. The
/// correction is another scale of the positions, or another order, sign or factor of the torques.
/// Returns "" if nothing is found. Each torque is regressed on the torque that the URDF predicts,
/// and on the acceleration, velocity and direction of its joint.
/// @param error rms of the torque that the fit leaves, over the peak torque, of each joint. Signs
/// are always considered. Scales, factors and orders are considered only if an entry is above
/// `no_fit`
std::string remedy_of(const Recording& table, const Eigen::VectorXd& error);

/// Share of the peak torque above which a table does not fit the robot.
inline constexpr double no_fit = 0.5;

}  // namespace tachless::identify

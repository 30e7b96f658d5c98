#pragma once

#include <Eigen/Core>
#include <string>

namespace tachless::robot {

/// Mass, centre of mass and inertia of something rigid, in one frame.
struct MassProperties {
  double mass = 0;                                 ///< [kg]
  Eigen::Vector3d p_cm = Eigen::Vector3d::Zero();  ///< [m]
  Eigen::Matrix3d I_cm = Eigen::Matrix3d::Zero();  ///< about the centre of mass [kg m2]
};

/// Two rigid things, in the same frame, as one.
MassProperties combine(const MassProperties& a, const MassProperties& b);

/// Empty when a rigid body can have these properties, else what forbids it, with the value and
/// the remedy. Allowed for rounding in what people print: 1e-6 of the largest principal moment.
std::string why_not_physical(const MassProperties& body);

}  // namespace tachless::robot

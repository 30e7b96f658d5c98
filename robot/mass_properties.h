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

/// Two rigid things, in the same frame, as one. Inertia without mass counts too.
MassProperties combine(const MassProperties& a, const MassProperties& b);

/// R I R', symmetric, and exactly I for R = 1.
Eigen::Matrix3d rotated(const Eigen::Matrix3d& I, const Eigen::Matrix3d& R);

/// Empty when a rigid body can have these properties, else what forbids it, with the value and
/// the remedy. Allowed for rounding in what people print: 1e-6 of the largest principal moment, and
/// a radius of gyration of 1e-6 m.
std::string why_not_physical(const MassProperties& body);

}  // namespace tachless::robot

#pragma once

#include <map>
#include <string>

namespace tachless::robot {

/// What a URDF seldom has of a joint.
struct JointNumbers {
  double rotor_inertia = 0;     ///< on the link side of the gear [kg m2; kg]
  double viscous_friction = 0;  ///< [N m s/rad; N s/m]
  double coulomb_friction = 0;  ///< [N m; N]
};

/// `armature`, `damping` and `frictionloss` of the named joints of a MuJoCo model, by name, with
/// the defaults of its classes. Nothing else of the file is read.
/// @param source the file's name, for messages
/// @throw std::invalid_argument, one line, for what is no MJCF, an <include>, an armature of an
/// actuator, an unknown class or attribute, and what is no finite number from 0 on
std::map<std::string, JointNumbers> read_mjcf_joints(const std::string& text,
                                                     const std::string& source);

}  // namespace tachless::robot

#pragma once

#include <map>
#include <string>

#include "robot/mjcf.h"

namespace tachless::robot {

/// Numbers of a joint that a URDF seldom has.
struct JointNumbers {
  double rotor_inertia = 0;     ///< inertia of the rotor on the link side of the gear [kg m2; kg]
  double viscous_friction = 0;  ///< [N m s/rad; N s/m]
  double coulomb_friction = 0;  ///< [N m; N]
  double reference = 0;         ///< position at which the bodies are as written [rad; m]
};

/// Reads `armature`, `damping` and `frictionloss` of the named joints of a MuJoCo model, by name.
/// Follows includes and applies the defaults of classes. Reads nothing else of the file.
/// @param source the file's name, for messages
/// @throw std::invalid_argument, one line, if the text is no MJCF, an actuator has an armature, a
/// class, element or attribute is unknown, or a value is negative or not finite
std::map<std::string, JointNumbers> read_mjcf_joints(const std::string& text,
                                                     const std::string& source,
                                                     const IncludedText& included);

}  // namespace tachless::robot

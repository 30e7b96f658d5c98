#pragma once

#include "robot/model.h"

namespace tachless::robot {

/// Reflected inertia of a geared rotor over the joint's largest torque [s^2], by a rule of thumb.
/// Published values of this ratio are 0.0065 to 0.0125 (Puma 560: Corke and Armstrong-Helouvry
/// 1994), 0.01 (a servo of 3 N m with armature 0.028 kg m2), 0.0022 and 0.0062 (FR3, armatures
/// 0.195 and 0.074 kg m2 of the public MJCF). The rule lies near the low end, because gains for
/// rotors that are too heavy are too stiff. The rule does not suit drives with gears below about
/// 10:1, which have a twentieth of this inertia.
inline constexpr double rotor_inertia_per_torque = 0.003;

/// Returns the rotor inertia of each joint by the rule of thumb, on the link side of the gear
/// [kg m2], two digits. It is `rotor_inertia_per_torque` times the effort limit for a revolute
/// joint. It is 0 for a prismatic joint: the rule does not know the radius of its pinion.
/// @throw std::invalid_argument for a revolute joint without effort limit
Vector typical_rotor_inertia(const Model& model);

}  // namespace tachless::robot

#pragma once

#include "robot/model.h"

namespace tachless::robot {

/// Returns a bound of each joint's gravity torque over all postures [N m; N]. A joint bears the
/// weight of the bodies beyond it, each at most the length of its chain of offsets away. The bound
/// is not the least one. It is infinite beyond a prismatic joint without limits.
Vector gravity_bound(const Model& model);

}  // namespace tachless::robot

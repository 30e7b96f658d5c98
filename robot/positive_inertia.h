#pragma once

#include <string>
#include <vector>

#include "robot/model.h"

namespace tachless::robot {

/// Whether each body can have the inertia it has.
bool is_possible(const Model& model);

/// The joints at which the inertia matrix is not positive definite, each pivot above rounding of
/// its diagonal entry, at the posture nearest to 0 or at one of some others in the joints' range:
/// 8, or 1000 where a body has an inertia that none can have.
std::vector<std::string> joints_without_inertia(const Model& model);

}  // namespace tachless::robot

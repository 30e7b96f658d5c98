#pragma once

#include <variant>

#include "reference/trajectory/hold.h"
#include "reference/trajectory/point_to_point.h"
#include "reference/trajectory/sinusoids.h"
#include "reference/trajectory/waypoints.h"

/// The list of all trajectories. To add one: a header in trajectory/ with a struct that has a
/// `name`, its `keys` and `at(t)` (or `Shape`, the type with `at` that is made of it), and its line
/// here. The scenario's keys, their documentation and the node follow.
namespace tachless::reference {

/// The scenario's `reference` map.
using Spec = std::variant<trajectory::Hold, trajectory::Sinusoid, trajectory::MultiSine,
                          trajectory::PointToPoint, trajectory::Waypoints, trajectory::MotionFile>;

}  // namespace tachless::reference

#pragma once

#include <variant>

#include "reference/trajectory/hold.h"
#include "reference/trajectory/point_to_point.h"
#include "reference/trajectory/sinusoids.h"
#include "reference/trajectory/waypoints.h"

/// The list of all trajectories. To add one, write a header in trajectory/ with a struct that has a
/// `name` and `keys`. The struct also has `at(t)`, or a type `Shape` with `at` that is constructed
/// from the struct, and `composition()`. Then add its line here. The scenario's keys, their
/// documentation and the node use this list.
namespace tachless::reference {

/// The scenario's `reference` map.
using Spec = std::variant<trajectory::Hold, trajectory::Sinusoid, trajectory::MultiSine,
                          trajectory::PointToPoint, trajectory::Waypoints, trajectory::MotionFile>;

/// Returns the parts of a reference; none for a `MotionFile` whose table was not read.
inline trajectory::Composition composition_of(const Spec& spec) {
  return std::visit([](const auto& each) { return each.composition(); }, spec);
}

}  // namespace tachless::reference

#pragma once

#include <variant>

#include "experiment/scenario.h"
#include "loop/signals.h"
#include "reference/trajectory/hold.h"
#include "reference/trajectory/multi_sine.h"
#include "reference/trajectory/point_to_point.h"
#include "reference/trajectory/waypoints.h"

namespace tachless::reference {

/// What a robot is to follow: pure, t -> reference, C4 for t >= 0. A new kind is one more
/// alternative.
class Trajectory {
 public:
  using Shape = std::variant<trajectory::Hold, trajectory::MultiSine, trajectory::PointToPoint,
                             trajectory::Waypoints>;

  explicit Trajectory(Shape shape) : shape_(std::move(shape)) {}

  /// Position to snap at t [s] since the start of the run, one entry per joint. Allocates nothing.
  [[nodiscard]] loop::ReferencePoint at(double t_s) const {
    return std::visit([t_s](const auto& shape) { return shape.at(t_s); }, shape_);
  }

 private:
  Shape shape_;
};

/// The trajectory a scenario asks for.
/// @throw diagnostics::Failure(bad_usage), one line with file, line, key, value and allowed range:
/// vectors without one entry per joint, duration <= 0, times not increasing, or a reference that
/// leaves the joint limits of the URDF during the run.
Trajectory make_trajectory(const experiment::Scenario& scenario);

}  // namespace tachless::reference

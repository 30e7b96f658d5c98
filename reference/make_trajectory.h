#pragma once

#include <variant>

#include "experiment/scenario.h"
#include "loop/signals.h"
#include "reference/trajectories.h"

/// From what a scenario asks for to the reference at a time. Does not read the scenario's file.
namespace tachless::reference {

/// The type with `at(t)` that is made of a trajectory's spec: `Spec::Shape`, or the spec itself.
template <class T>
struct ShapeOf {
  using Type = T;
};
template <class T>
requires requires { typename T::Shape; }
struct ShapeOf<T> {
  using Type = typename T::Shape;
};

template <class Variant>
struct ShapesOf;
template <class... T>
struct ShapesOf<std::variant<T...>> {
  using Type = std::variant<typename ShapeOf<T>::Type...>;
};

/// What a robot is to follow: pure, t -> reference, C4 for t >= 0.
class Trajectory {
 public:
  /// @throw std::invalid_argument, one line, when the spec makes no sense.
  explicit Trajectory(const Spec& spec)
      : shape_(std::visit(
            []<class T>(const T& made) { return Shape(typename ShapeOf<T>::Type(made)); }, spec)) {}

  /// Position to snap at t [s] since the start of the run, one entry per joint. Allocates nothing.
  [[nodiscard]] loop::ReferencePoint at(double t_s) const {
    return std::visit([t_s](const auto& shape) { return shape.at(t_s); }, shape_);
  }

 private:
  using Shape = ShapesOf<Spec>::Type;
  Shape shape_;
};

/// The trajectory a scenario asks for.
/// @throw diagnostics::Failure(bad_usage), one line with file, line, key, value and allowed range,
/// for a reference that leaves the joint limits of the URDF during the run.
Trajectory make_trajectory(const experiment::Scenario& scenario);

}  // namespace tachless::reference

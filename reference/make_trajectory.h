#pragma once

#include <algorithm>
#include <functional>
#include <variant>

#include "experiment/scenario.h"
#include "loop/signals.h"
#include "reference/trajectories.h"

/// From what a scenario asks for to the reference at a time. Does not read the scenario's file.
namespace tachless::reference {

/// What a robot is to follow: pure, t -> reference, C4 for t >= 0.
class Trajectory {
 public:
  /// @throw std::invalid_argument, one line, when the spec makes no sense.
  explicit Trajectory(const Spec& spec)
      : at_(std::visit(
            []<class T>(const T& made) -> At {
              if constexpr (requires { typename T::Shape; }) {
                return [shape = typename T::Shape(made)](double t_s) { return shape.at(t_s); };
              } else {
                return [made](double t_s) { return made.at(t_s); };
              }
            },
            spec)) {}

  /// Position to snap at t [s] since the start of the run, one entry per joint. Allocates nothing.
  [[nodiscard]] loop::ReferencePoint at(double t_s) const { return at_(t_s); }

 private:
  using At = std::function<loop::ReferencePoint(double t_s)>;
  At at_;
};

/// The trajectory a scenario asks for.
/// @throw diagnostics::Failure(bad_usage), one line with file, line, key, value and allowed range,
/// for a reference that leaves the joint limits of the URDF during the run.
Trajectory make_trajectory(const experiment::Scenario& scenario);

/// The last of the instants 0, 1, ... at which a run's reference is checked: at most 10 ms apart up
/// to 2000 s, so that a sinusoid of 2 Hz is between two beyond both by 0.2 % of its amplitude.
inline int last_instant(double duration_s) {
  return static_cast<int>(std::clamp(duration_s / 0.01, 2e3, 2e5));
}

}  // namespace tachless::reference

#pragma once

#include <functional>
#include <variant>
#include <vector>

#include "messages/signals.h"
#include "reference/spec.h"
#include "scenario/scenario.h"

/// The reference of a scenario as a function of time. This header does not read the scenario's
/// file.
namespace tachless::reference {

/// A robot's desired motion: a pure function of time, C4 for t >= 0.
class Trajectory {
 public:
  /// @throw std::invalid_argument, with one line, if the spec is invalid.
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

  /// Returns position to snap at t [s] since the start of the run, one entry per joint. Allocates
  /// no memory.
  [[nodiscard]] messages::ReferencePoint at(double t_s) const { return at_(t_s); }

 private:
  using At = std::function<messages::ReferencePoint(double t_s)>;
  At at_;
};

/// Returns the trajectory of a scenario.
/// @throw base::Failure(bad_usage), one line with file, line, key, value and allowed range, if the
/// reference leaves the joint limits of the URDF during the run.
Trajectory make_trajectory(const scenario::Scenario& scenario);

/// Time interval in which a reference moves within its run [s], with sample times. For sinusoids
/// the interval is one common period. For other references it lasts from the first motion to the
/// last, with the pauses between them. A constant reference has an interval of length 0.
class Motion {
 public:
  /// Precondition: the table of a `MotionFile` has been read.
  Motion(const scenario::Scenario& scenario, const Trajectory& trajectory);

  double begin_s = 0, end_s = 0;
  bool repeats = false;  ///< the reference is periodic, and a period fits within the run

  [[nodiscard]] bool moves() const { return end_s > begin_s; }
  /// Maps a share in [0, 1] to time; short segments get at least a quarter of the mean share.
  [[nodiscard]] double at(double share) const;
  /// Returns `count` increasing sample times including both ends, or one time if nothing moves. The
  /// times of a periodic motion with few samples are jittered to avoid aliasing.
  [[nodiscard]] std::vector<double> instants(int count) const;
  /// Returns 50 sample times per period of the fastest sinusoid. A peak is missed by at most 0.2 %.
  /// Between waypoints it returns 4 times for each segment.
  [[nodiscard]] std::vector<double> closely(int at_least = 2000, int at_most = 200000) const;

 private:
  std::vector<double> time_s_, share_;  ///< waypoints' times [s] and shares of the interval
  double cycles_ = 0;                   ///< number of periods of the fastest sinusoid
};

}  // namespace tachless::reference

#pragma once

#include <functional>
#include <variant>
#include <vector>

#include "messages/signals.h"
#include "reference/spec.h"
#include "scenario/scenario.h"

/// From what a scenario asks for to the reference at a time. Does not read the scenario's file.
namespace tachless::reference {

/// Motion that a robot is to follow: a pure function of time, C4 for t >= 0.
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
  [[nodiscard]] messages::ReferencePoint at(double t_s) const { return at_(t_s); }

 private:
  using At = std::function<messages::ReferencePoint(double t_s)>;
  At at_;
};

/// The trajectory a scenario asks for.
/// @throw base::Failure(bad_usage), one line with file, line, key, value and allowed range,
/// for a reference that leaves the joint limits of the URDF during the run.
Trajectory make_trajectory(const scenario::Scenario& scenario);

/// The sinusoids of a reference; empty: it is not made of them.
std::vector<trajectory::Sine> sines_of(const Spec& spec);

/// When a reference moves within its run [s], and when to look at it: one common period of
/// sinusoids, otherwise from its first motion to its last, pauses between them included. Of length
/// 0 where it is constant.
class Motion {
 public:
  /// Precondition: the table of a `MotionFile` was read.
  Motion(const scenario::Scenario& scenario, const Trajectory& trajectory);

  double begin_s = 0, end_s = 0;
  bool repeats = false;  ///< within the run

  [[nodiscard]] bool moves() const { return end_s > begin_s; }
  /// Maps a share in [0, 1] to time; short segments get at least a quarter of the mean share.
  [[nodiscard]] double at(double share) const;
  /// Returns `count` increasing sample times including both ends, jittered for periodic motion to
  /// avoid aliasing; one time if nothing moves.
  [[nodiscard]] std::vector<double> instants(int count) const;
  /// Returns 50 sample times a period of the fastest sinusoid (peaks are missed by at most 0.2 %),
  /// and 4 for each segment between waypoints.
  [[nodiscard]] std::vector<double> closely(int at_least = 2000, int at_most = 200000) const;

 private:
  std::vector<double> time_s_, share_;  ///< of the waypoints
  double cycles_ = 0;                   ///< of the fastest sinusoid
};

}  // namespace tachless::reference

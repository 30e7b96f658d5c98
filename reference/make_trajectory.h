#pragma once

#include <functional>
#include <variant>
#include <vector>

#include "messages/signals.h"
#include "reference/spec.h"
#include "scenario/scenario.h"

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
  /// The time after that share of it, 0 … 1: even in time, but that no piece between waypoints has
  /// less than about a quarter of the mean.
  [[nodiscard]] double at(double share) const;
  /// As many, the first and the last included, increasing; one where it does not move. Even in
  /// `at`, but irregular where even ones may lie at the same phase of each period.
  [[nodiscard]] std::vector<double> instants(int count) const;
  /// 50 for each period of the fastest sinusoid, so that it is between two beyond both by 0.2 % of
  /// its amplitude, and 4 for each piece between waypoints.
  [[nodiscard]] std::vector<double> closely(int at_least = 2000, int at_most = 200000) const;

 private:
  std::vector<double> time_s_, share_;  ///< of the waypoints
  double cycles_ = 0;                   ///< of the fastest sinusoid
};

}  // namespace tachless::reference

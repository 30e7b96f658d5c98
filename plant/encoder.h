#pragma once

#include <cstdint>

#include "experiment/scenario.h"
#include "loop/signals.h"
#include "plant/arm.h"
#include "robot/model.h"

namespace tachless::plant {

/// The position encoders of all joints (and the tachometers, for laws that measure velocity):
/// true state in, measurement out. A measurement is a function of (scenario, state, tick) alone:
/// the noise is drawn by a counter-based generator, from the seed, the tick, the joint and the
/// channel, so that repeating a tick repeats its noise and no channel shifts another's.
///
/// Position: noise is added first, then the sum is rounded to the nearest count. A revolute joint
/// has 2^bits counts a revolution, a prismatic joint 2^bits counts over its URDF range. Velocity:
/// noise only. On a rigid robot a motor encoder reads the link's position.
class Encoder {
 public:
  /// @throw diagnostics::Failure(bad_usage) when a prismatic joint has a resolution but no range.
  Encoder(const experiment::Scenario& scenario, const robot::Model& model);

  /// The measurement of tick `tick`. Precondition: `require_encoders<Measurement>` passes.
  /// `Measurement` is one of the four of robot/signals.h.
  template <class Measurement>
  [[nodiscard]] Measurement measure(const ArmState& state, std::int64_t tick) const;

  /// Width of one count [rad; m if prismatic]; 0 for an ideal encoder.
  [[nodiscard]] const robot::Vector& count() const { return count_; }

 private:
  enum class Channel : std::uint32_t {
    link_position,
    motor_position,
    link_velocity,
    motor_velocity
  };

  [[nodiscard]] robot::Vector position(const robot::Vector& exact, Channel channel,
                                       std::int64_t tick) const;
  [[nodiscard]] robot::Vector velocity(const robot::Vector& exact, Channel channel,
                                       std::int64_t tick) const;

  robot::Vector count_;
  double position_noise_;
  double velocity_noise_;
  std::uint64_t seed_;
};

template <>
loop::PositionMeasurement Encoder::measure(const ArmState& state, std::int64_t tick) const;
template <>
loop::MotorPositionMeasurement Encoder::measure(const ArmState& state, std::int64_t tick) const;
template <>
loop::LinkStateMeasurement Encoder::measure(const ArmState& state, std::int64_t tick) const;
template <>
loop::StateMeasurement Encoder::measure(const ArmState& state, std::int64_t tick) const;

/// Checks that the scenario's robot has what `Measurement` (one of the four of robot/signals.h)
/// needs.
/// @throw diagnostics::Failure(bad_usage) naming the key and the missing encoder.
template <class Measurement>
void require_encoders(const experiment::Scenario& scenario);
template <>
void require_encoders<loop::PositionMeasurement>(const experiment::Scenario& scenario);
template <>
void require_encoders<loop::MotorPositionMeasurement>(const experiment::Scenario& scenario);
template <>
void require_encoders<loop::LinkStateMeasurement>(const experiment::Scenario& scenario);
template <>
void require_encoders<loop::StateMeasurement>(const experiment::Scenario& scenario);

/// Standard normal number belonging to (seed, tick, channel, joint): Philox4x32-10 (Salmon et al.,
/// "Parallel random numbers: as easy as 1, 2, 3", 2011) and the Box-Muller transform, spelled out
/// so that every standard library gives the same numbers.
double standard_normal(std::uint64_t seed, std::int64_t tick, std::uint32_t channel,
                       std::uint32_t joint);

}  // namespace tachless::plant

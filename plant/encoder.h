#pragma once

#include <cstdint>

#include "messages/measurements.h"
#include "plant/arm_state.h"
#include "plant/spec.h"
#include "robot/model.h"

namespace tachless::plant {

/// The position encoders of all joints, and the tachometers for laws that measure velocity. A
/// measurement is a function of spec, state and tick alone. A counter-based generator draws the
/// noise from seed, tick, joint and channel. A repeated tick therefore repeats its noise, and the
/// noise of a channel does not depend on the others.
///
/// Position: the eccentricity of a revolute link and the noise are added, then the sum is rounded
/// to the nearest count. A revolute joint has 2^bits counts a revolution, a prismatic joint 2^bits
/// counts over its URDF range. Velocity: noise only.
class Encoder {
 public:
  /// @param count width of one count of each joint (scenario::encoder_count) [rad; m if prismatic];
  /// 0: ideal
  Encoder(const EncoderSpec& spec, const Vector& count, const robot::Model& model);

  /// Returns the measurement of tick `tick`. Precondition: `scenario::require_encoders` passes.
  template <class Measurement>
  [[nodiscard]] Measurement measure(const ArmState& state, std::int64_t tick) const {
    Measurement m;
    if constexpr (requires { m.q; }) m.q = read(state.q, Channel::link_position, tick);
    if constexpr (requires { m.v; }) m.v = read(state.v, Channel::link_velocity, tick);
    if constexpr (requires { m.theta; }) m.theta = read(state.theta, Channel::motor_position, tick);
    if constexpr (requires { m.thetadot; }) {
      m.thetadot = read(state.thetadot, Channel::motor_velocity, tick);
    }
    return m;
  }

 private:
  enum class Channel : std::uint32_t {
    link_position,
    motor_position,
    link_velocity,
    motor_velocity
  };

  [[nodiscard]] Vector read(const Vector& exact, Channel channel, std::int64_t tick) const;

  Vector eccentricity_, phase_;
  Vector count_;  ///< width of one count [rad; m if prismatic]; 0 for an ideal encoder
  double position_noise_;
  double velocity_noise_;
  std::uint64_t seed_;
};

/// Returns the standard normal number of (seed, tick, channel, joint), by Philox4x32-10 (Salmon et
/// al., "Parallel random numbers: as easy as 1, 2, 3", 2011) and the Box-Muller transform. It is
/// the same with every standard library.
double standard_normal(std::uint64_t seed, std::int64_t tick, std::uint32_t channel,
                       std::uint32_t joint);
/// Returns a number in (0, 1), for drives' delays, by the same generator.
double standard_uniform(std::uint64_t seed, std::int64_t tick);

}  // namespace tachless::plant

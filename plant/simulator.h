#pragma once

#include "base/quantities.h"
#include "plant/arm_state.h"

namespace tachless::plant {

/// Mechanics of a robot that a program steps, in place of the emulator's own. The encoders, drives,
/// delays, noise, limits and the protective stop of the scenario still apply. Time is the run's
/// time: the mechanics move when `advance` asks, in lockstep and in realtime. Joints are in the
/// order and units of the scenario's robot. All calls come from one thread.
class Simulator {
 public:
  virtual ~Simulator() = default;

  /// Sets the time to 0, the joints to this state, and everything else to the mechanics' own
  /// initial state. The loop calls it once at the beginning of each run.
  virtual void reset(const ArmState& initial) = 0;

  /// Returns positions and velocities of the joints now. `disturbance` may have torques that no
  /// drive gives, such as contact torques; only the log uses it.
  [[nodiscard]] virtual ArmState state() = 0;

  /// Holds `tau` [N m; N] on the joints until the time `until_s` of the run. A tick is one call, or
  /// two with plant.drive.delay_fraction. Equal calls have to give equal bits, so that a repeated
  /// run has the same log.
  /// @throw std::runtime_error when the mechanics cannot go on; the run ends by a protective stop
  virtual void advance(const Vector& tau, double until_s) = 0;

  /// Adds viscous braking [N m s/rad; N s/m] to the joints from now on: the protective stop. `tau`
  /// is 0 from then on.
  virtual void brake(const Vector& damping) = 0;
};

}  // namespace tachless::plant

#pragma once

#include <cstdint>
#include <memory>

#include "plant/spec.h"
#include "robot/model.h"
#include "robot/quantities.h"

/// The emulated arm: mechanics and integrator behind one interface, no SimTK type here,
/// C++17-clean.
namespace tachless::plant {

struct ArmState {
  robot::Vector q;         ///< link position [rad; m if prismatic]
  robot::Vector v;         ///< link velocity [rad/s]
  robot::Vector theta;     ///< motor position [rad]; empty on a rigid robot
  robot::Vector thetadot;  ///< motor velocity [rad/s]; empty on a rigid robot
};

struct ArmAcceleration {
  robot::Vector vdot;       ///< of the links [rad/s^2; m/s^2 if prismatic]
  robot::Vector thetaddot;  ///< of the motors [rad/s^2]; empty on a rigid robot
};

struct ArmOptions {
  Mechanics mechanics = Mechanics::simbody;
  const FlexibleDrive* flexible = nullptr;  ///< rigid joints when null
  robot::Vector viscous_friction;           ///< on the links' joints [N m s/rad]
  Integrator integrator = Integrator::runge_kutta_merson;
  double accuracy = 1e-9;
};

class ArmEngine;

/// A multibody arm whose motor torque is held over each call of `advance`.
class Arm {
 public:
  /// The arm of `model` (gravity, added rotor inertia and payload included).
  /// @throw std::invalid_argument when the native mechanics have no such integrator.
  Arm(const robot::Model& model, const ArmOptions& options, const ArmState& initial);
  ~Arm();
  Arm(Arm&&) noexcept;
  Arm& operator=(Arm&&) noexcept;

  [[nodiscard]] const ArmState& state() const;

  /// What the arm would do now under motor torque `tau` [N m]: the right-hand side that `advance`
  /// integrates.
  /// @throw std::runtime_error if the inertia matrix is not positive definite.
  [[nodiscard]] ArmAcceleration acceleration(const robot::Vector& tau) const;

  /// Steps that the integrator has taken since the start.
  [[nodiscard]] std::int64_t integrator_steps() const;

  /// Integrates to absolute time `time_s` with motor torque `tau` [N m] held from now to then.
  /// @throw std::runtime_error with time and cause when the integrator gives up.
  void advance(const robot::Vector& tau, double time_s);

  /// Adds viscous braking [N m s/rad] at the motors (links if rigid), from now on: the
  /// protective stop.
  void brake(const robot::Vector& damping);

 private:
  int num_joints_ = 0;
  double now_s_ = 0;
  std::unique_ptr<ArmEngine> engine_;
};

}  // namespace tachless::plant

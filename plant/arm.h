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
  /// Torque on the links that no drive gives [N m; N]; empty: none. For the log alone.
  robot::Vector disturbance{};
};

struct ArmAcceleration {
  robot::Vector vdot;       ///< of the links [rad/s^2; m/s^2 if prismatic]
  robot::Vector thetaddot;  ///< of the motors [rad/s^2]; empty on a rigid robot
};

/// Torque on the links that no drive gives: a function of time and position, with jumps.
class OutsideTorque {
 public:
  OutsideTorque() = default;
  OutsideTorque(const OutsideTorque&) = delete;
  OutsideTorque& operator=(const OutsideTorque&) = delete;
  virtual ~OutsideTorque() = default;

  /// The first jump after `from_s`, at `until_s` at the latest.
  [[nodiscard]] virtual double next_jump(double from_s, double until_s) const = 0;
  /// What is added from now on is of the time from `from_s` to `until_s`, inside which is no jump.
  virtual void choose(double from_s, double until_s) = 0;
  /// Adds the torque at `time_s` and link position `q` to `tau` [N m].
  virtual void add(double time_s, const double* q, robot::Vector& tau) const = 0;
};

struct ArmOptions {
  Mechanics mechanics = Mechanics::simbody;
  const FlexibleDrive* flexible = nullptr;  ///< rigid joints when null
  robot::Vector viscous_friction;           ///< on the links' joints [N m s/rad]
  /// Coulomb's, static (at least Coulomb's) [N m] and the speed of the fall from one to the other
  /// [rad/s]; empty: none. Native mechanics only.
  robot::Vector coulomb_friction, static_friction, stribeck_velocity;
  OutsideTorque* outside = nullptr;  ///< outlives the arm; none when null
  double start_s = 0;                ///< time of the initial state
  Integrator integrator = Integrator::runge_kutta_merson;
  double accuracy = 1e-9;
};

class ArmEngine;

/// A multibody arm whose motor torque is held over each call of `advance`.
class Arm {
 public:
  /// The arm of `model` (gravity, added rotor inertia and payload included).
  /// @throw std::invalid_argument when the native mechanics have no such integrator, or Simbody's
  /// are to have Coulomb's friction.
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
  OutsideTorque* outside_ = nullptr;
  std::unique_ptr<ArmEngine> engine_;
};

}  // namespace tachless::plant

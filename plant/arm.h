#pragma once

#include <array>
#include <memory>
#include <optional>

#include "base/quantities.h"
#include "plant/arm_state.h"
#include "plant/disturbances.h"
#include "plant/dry_friction.h"
#include "plant/multibody.h"
#include "plant/spec.h"
#include "robot/model.h"

namespace tachless::plant {

struct ArmOptions {
  Mechanics mechanics = Mechanics::simbody;
  double accuracy = 1e-9;  ///< relative accuracy of an integrator's step
  DriveSpec drive;  ///< friction, current loop, scale and offset are used; empty vectors are none
  const FlexibleDrive* flexible = nullptr;  ///< rigid joints when null
  Disturbances* disturbances = nullptr;     ///< none when null; must outlive the arm
};

/// A multibody arm with drives: the paper's eq. 1 (flexible joints) or eq. 2 (rigid joints) with
/// friction and disturbances, integrated by Merson's Runge-Kutta method. Springs may have viscous
/// dampers beside them. Each call of `advance` commands a motor torque, which the drives follow.
/// Rotors of flexible joints are pinned to the ground (Spong's simplification), so each rotor is a
/// scalar equation.
class Arm {
 public:
  /// Makes the arm of `model`, which includes gravity, added rotor inertia and payload.
  /// @throw std::logic_error when a size is wrong.
  Arm(const robot::Model& model, const ArmOptions& options, const ArmState& initial);

  [[nodiscard]] ArmState state() const;
  /// Sets state and time, as if the arm had been constructed with them.
  void set_state(const ArmState& state, double time_s);

  /// Integrates to absolute time `time_s` with motor torque `tau` [N m] held from now to then.
  /// @throw std::runtime_error with time and cause if the integrator fails.
  void advance(const Vector& tau, double time_s);

  /// Switches the drives off and adds viscous braking [N m s/rad] at the motors (at the links if
  /// rigid): the protective stop.
  void brake(const Vector& damping);

 private:
  /// Vector (q, theta) or its rates, without allocation.
  using Coordinates = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, 2 * max_joints, 1>;
  static constexpr std::size_t num_stages = 5;

  void accelerate(double time_s, const Coordinates& x, const Coordinates& xdot, Coordinates& xddot);
  /// Returns the torque of a drive under the command `tau_` [N m; N].
  [[nodiscard]] double torque(Eigen::Index joint, double time_s) const;
  void choose_sticking();
  void integrate(double end_s);
  void take_step(double end_s);
  double try_step(double h);
  std::optional<double> shorten_to_change(double h);

  Eigen::Index num_joints_;
  std::unique_ptr<Multibody> links_;
  double accuracy_;
  bool flexible_;
  Vector K_, J_, motor_damping_, spring_damping_, rigid_rotor_inertia_, viscous_friction_;
  Vector current_rate_;  ///< bandwidth of the current loops [rad/s]; 0: the torque acts at once
  Vector torque_scale_, torque_offset_;
  DryFriction dry_friction_, motor_friction_;
  Disturbances* disturbances_;

  Vector tau_;  ///< commanded
  Vector lag_;  ///< torque of the drives less `tau_` at since_s_, the time of the command
  double since_s_ = 0;
  Coordinates x_, xdot_;  ///< at now_s_
  double now_s_ = 0;
  double step_s_ = 0;  ///< length of the next step to try

  // Work space of an evaluation and of a step.
  Vector q_, v_, load_, gravity_;
  Coordinates xddot_;
  std::array<Coordinates, num_stages> rate_, acceleration_;
  Coordinates next_x_, next_xdot_, error_x_, error_xdot_;
};

}  // namespace tachless::plant

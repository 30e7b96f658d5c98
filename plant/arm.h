#pragma once

#include <cstdint>
#include <memory>
#include <vector>

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

/// The scenario's `plant.disturbances` (docs/plant.md) as torques on the links' joints that no
/// drive gives. A function of the specs, the time and the links' position alone, with jumps: noise
/// is drawn by seed, tick and the number of the disturbance.
class Disturbances {
 public:
  /// @param specs, model of which the joints and links are: both outlive this.
  Disturbances(const std::vector<DisturbanceSpec>& specs, double period_s,
               const robot::Model& model);

  /// The first jump after `from_s`, at `until_s` at the latest.
  [[nodiscard]] double next_jump(double from_s, double until_s) const;
  /// What is added from now on is of the time from `from_s` to `until_s`, inside which is no jump.
  void choose(double from_s, double until_s);
  /// Adds the torque at `time_s` and link position `q` to `tau` [N m].
  void add(double time_s, const double* q, robot::Vector& tau) const;

  /// The torque at `time_s`, the beginning of a tick [N m; N].
  [[nodiscard]] robot::Vector at(double time_s, const robot::Vector& q);

 private:
  struct Source {
    const DisturbanceSpec* spec;
    int joint;  ///< -1: a force on a link
    bool active = false;
    double noise = 0;
  };

  const robot::Model& model_;
  double period_s_;
  std::vector<Source> sources_;
};

struct ArmOptions {
  Mechanics mechanics = Mechanics::simbody;
  IntegratorSpec integrator;
  DriveSpec drive;                          ///< of which the friction; empty vectors are none
  const FlexibleDrive* flexible = nullptr;  ///< rigid joints when null
  Disturbances* disturbances = nullptr;     ///< outlive the arm; none when null
  double start_s = 0;                       ///< time of the initial state
};

class ArmMechanics;

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

  [[nodiscard]] const ArmState& state() const { return state_; }

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
  ArmState state_;
  Disturbances* disturbances_;
  std::unique_ptr<ArmMechanics> mechanics_;
};

}  // namespace tachless::plant

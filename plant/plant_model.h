#pragma once

#include <memory>
#include <optional>

#include "plant/arm.h"
#include "plant/disturbances.h"
#include "plant/drive.h"
#include "plant/robot_driver.h"
#include "plant/simulator.h"
#include "plant/spec.h"
#include "robot/model.h"
#include "scenario/scenario.h"

/// The plant of a scenario: the true robot, and its emulation.
namespace tachless::plant {

/// Returns the true robot at the start of the run: URDF, gravity, rotor inertia of rigid joints,
/// and the payload that the controller does not know.
/// @throw base::Failure(bad_usage) naming the key.
robot::Model plant_model(const scenario::Scenario& scenario);

/// Returns the same model without the payload.
robot::Model unloaded_model(const scenario::Scenario& scenario);

/// Springs and motors of flexible joints; nothing for rigid joints.
using Motors = std::optional<FlexibleDrive>;

/// Returns the state in which the run starts. Motors whose state is not given start at rest in
/// static balance: theta = q + K^-1 g(q).
ArmState initial_state(const Spec& plant, const Motors& motors, const robot::Model& model);

/// Returns the arm with this model at `start`. `motors` and `disturbances`, if not null, outlive
/// it.
Arm make_arm(const Spec& plant, const Motors& motors, const robot::Model& model,
             const ArmState& start, Disturbances* disturbances = nullptr);

/// Returns the drives with the limits, rates and jitter of the spec and the loop's command delay.
Drive make_drive(const Spec& plant, const scenario::LoopSpec& loop, const robot::Model& model);

/// Returns the viscous braking of the protective stop [N m s/rad]: each joint's inertia at `q`, as
/// its drive sees it, over 0.1 s. The joint comes to rest in some tenths of a second.
Vector protective_stop_damping(const Motors& motors, const robot::Model& model, const Vector& q);

/// The simulated robot: a simulator, or this library's own arm with payload and disturbances.
/// Viscous braking stops it (`protective_stop_damping`).
class EmulatedRobot final : public RobotDriver {
 public:
  /// All arguments except the period must outlive this object.
  /// @param model with the payload (`plant_model`)
  EmulatedRobot(const Spec& plant, const Motors& motors, double period_s,
                const robot::Model& model);
  /// Uses a simulator in place of this library's mechanics, and resets the simulator.
  EmulatedRobot(const Spec& plant, const Motors& motors, const robot::Model& model,
                Simulator& simulator);

  [[nodiscard]] bool measures_velocity() const override { return true; }
  void start() override {}
  ArmState read() override;
  /// @throw std::runtime_error if the integrator or the simulator fails.
  void hold(const Vector& tau, double until_s) override;
  void stop() override;
  void rest(double until_s) override;

 private:
  void advance(const Vector& tau, double until_s);

  const Spec& plant_;
  const Motors& motors_;
  const robot::Model& model_;
  std::unique_ptr<Simulator> own_;  ///< null: the caller owns the simulator
  Simulator& simulator_;
  double now_s_ = 0;
  Vector before_;  ///< torque over the previous tick; at first the initial torque
};

}  // namespace tachless::plant

#pragma once

#include <vector>

#include "plant/arm.h"
#include "plant/disturbances.h"
#include "plant/own_torque.h"
#include "plant/simulator.h"
#include "robot/model.h"
#include "scenario/scenario.h"

namespace tachless::identify {

/// The emulated arm of a scenario with rigid joints, which adds a torque of its own
/// (robot.compensates) as a driver's arm does. The loop sends the law's torque without what the arm
/// adds at the last reading. The sent torque acts late. The arm's own torque is held over each tick
/// too, and is that of the position a part of a tick ahead, so that it acts later by less than half
/// a tick.
class CompensatingArm final : public plant::Simulator {
 public:
  /// @param plant the true arm
  /// @param believed the scenario of the run, whose model the arm's own controller has; no delay of
  /// `plant` is less than its delay
  /// @param own_late ticks from a position until its own torque acts, in the mean: 0 to 0.5
  CompensatingArm(const scenario::Scenario& plant, const scenario::Scenario& believed,
                  double own_late);

  void reset(const plant::ArmState& initial) override;
  plant::ArmState state() override { return arm_.state(); }
  void advance(const Vector& tau, double until_s) override;
  void brake(const Vector& damping) override { arm_.brake(damping); }

 private:
  const scenario::Scenario& plant_;
  robot::Model model_;
  plant::Disturbances disturbances_;
  plant::Arm arm_;
  plant::OwnTorque own_;
  int late_;                   ///< whole ticks from a reading until the torque sent then acts
  double ahead_s_;             ///< of the position whose own torque acts
  std::vector<Vector> added_;  ///< own torque at each reading so far
  Vector acts_;                ///< own torque in this tick
  double now_s_ = 0;
};

/// Returns the scenario without its keys of mechanics, which a `CompensatingArm` replaces.
scenario::Scenario without_mechanics(scenario::Scenario scenario);

}  // namespace tachless::identify

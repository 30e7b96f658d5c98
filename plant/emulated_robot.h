#pragma once

#include "experiment/scenario.h"
#include "plant/arm.h"
#include "plant/robot_driver.h"
#include "robot/model.h"

namespace tachless::plant {

/// Simbody's arm in a robot's place. It stops by viscous braking (`protective_stop_damping`).
class EmulatedRobot final : public RobotDriver {
 public:
  /// @param model `plant_model(scenario)`. Both outlive this.
  EmulatedRobot(const experiment::Scenario& scenario, const robot::Model& model);

  [[nodiscard]] bool measures_velocity() const override { return true; }
  void start() override {}
  ArmState read() override { return arm_.state(); }
  /// @throw std::runtime_error when the integrator gives up.
  void hold(const robot::Vector& tau, double until_s) override { arm_.advance(tau, until_s); }
  void stop() override;
  void rest(double until_s) override;

 private:
  const experiment::Scenario& scenario_;
  const robot::Model& model_;
  Arm arm_;
};

}  // namespace tachless::plant

#pragma once

#include <vector>

#include "experiment/scenario.h"
#include "plant/arm.h"
#include "plant/disturbances.h"
#include "plant/plant_model.h"
#include "plant/robot_driver.h"
#include "robot/model.h"

namespace tachless::plant {

/// An arm in a robot's place, with disturbances and a payload that comes and goes. It stops by
/// viscous braking (`protective_stop_damping`); the payload then stays where it is.
class EmulatedRobot final : public RobotDriver {
 public:
  /// @param model `plant_model(scenario)`. Both outlive this.
  EmulatedRobot(const experiment::Scenario& scenario, const robot::Model& model);

  [[nodiscard]] bool measures_velocity() const override { return true; }
  void start() override {}
  ArmState read() override;
  /// @throw std::runtime_error when the integrator gives up.
  void hold(const robot::Vector& tau, double until_s) override;
  void stop() override;
  void rest(double until_s) override;

 private:
  const experiment::Scenario& scenario_;
  void advance(const robot::Vector& tau, double until_s);
  [[nodiscard]] OutsideTorque* outside();

  const robot::Model* model_;
  Disturbances disturbances_;
  std::vector<ModelChange> changes_;
  std::size_t num_changed_ = 0;
  double now_s_ = 0;
  Arm arm_;
};

}  // namespace tachless::plant

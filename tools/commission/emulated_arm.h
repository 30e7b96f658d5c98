#pragma once

#include <deque>
#include <optional>

#include "commission/commission.h"
#include "plant/arm.h"
#include "plant/encoder.h"
#include "plant/own_torque.h"
#include "plant/robot_driver.h"
#include "robot/model.h"
#include "scenario/scenario.h"

namespace tachless::commission {

/// The arm of a scenario behind a driver, with its signs, encoders and its own gravity
/// compensation. It emulates a manufacturer's arm. It does not move before `start` and after
/// `stop`.
class EmulatedArm : public plant::RobotDriver {
 public:
  explicit EmulatedArm(scenario::Scenario scenario);
  EmulatedArm(const EmulatedArm&) = delete;
  EmulatedArm& operator=(const EmulatedArm&) = delete;

  [[nodiscard]] bool measures_velocity() const override { return false; }
  void start() override;
  plant::ArmState read() override;
  void hold(const Vector& tau, double until_s) override;
  void stop() override { arm_.reset(); }
  /// Holds the torque of the previous tick.
  void rest(double until_s) override {
    if (moves()) hold(last_, until_s);
  }

  [[nodiscard]] const plant::ArmState& state() const { return now_; }  ///< exact state

 protected:
  [[nodiscard]] bool moves() const { return arm_.has_value(); }

 private:
  scenario::Scenario scenario_;
  robot::Model model_;
  plant::OwnTorque own_torque_;
  plant::Encoder encoder_;
  plant::ArmState now_;
  std::deque<plant::ArmState> past_;  ///< states that the encoder's latency delays
  std::optional<plant::Arm> arm_;     ///< set while the arm moves
  Vector last_;                       ///< last torque [N m; N]
  std::int64_t readings_ = 0;
};

/// Returns trials in this process on `arm`, which must outlive them.
Trials trials_on(plant::RobotDriver& arm);

}  // namespace tachless::commission

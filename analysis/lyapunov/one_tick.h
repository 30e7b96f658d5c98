#pragma once

#include <Eigen/Core>
#include <memory>

#include "linear/scenario_loop.h"

namespace tachless::lyapunov {

/// One period of a scenario's loop as it is coded, with the reference held at a posture. The period
/// includes the emulator's arm with the torque held over the tick, friction, the law's own step,
/// torque limits and delay. Encoders are ideal. Disturbances, torque offsets and torque rates are
/// left out.
///
/// The state x is the deviation from rest at that posture, in the order of `cut`. The plant comes
/// first: (q, v), with flexible joints (q, v, theta, thetadot), and the torques of current loops
/// that lag. The law's memory before the tick follows, then the torques that have been commanded
/// and do not act yet, the newest first.
class OneTick {
 public:
  /// Precondition: `controller::LawFacts::no_linearisation` is empty.
  /// @throw base::Failure(bad_usage) as `ScenarioLoop`.
  OneTick(const scenario::Scenario& scenario, const Vector& q_ref);

  /// Returns x at the next tick; NaN if the plant cannot be integrated.
  [[nodiscard]] Eigen::VectorXd operator()(const Eigen::VectorXd& x) const;
  /// Returns the gradient at x = 0.
  [[nodiscard]] Eigen::MatrixXd linear() const;

  /// Returns x of a run that starts with this deviation of the plant's state. The law has its start
  /// memory for this state, and the commanded torques hold the reference.
  [[nodiscard]] Eigen::VectorXd start(const Eigen::VectorXd& plant) const;

  [[nodiscard]] Eigen::Index num_joints() const { return torque_.size(); }
  [[nodiscard]] Eigen::Index plant_size() const { return plant_.size(); }
  [[nodiscard]] Eigen::Index size() const;
  [[nodiscard]] const Vector& q_ref() const { return reference_.q_ref; }
  [[nodiscard]] int delay() const { return settings_.command_delay; }

 private:
  std::shared_ptr<const scenario::Scenario> scenario_;
  linear::ScenarioLoop loop_;
  messages::ReferencePoint reference_;
  robot::Model model_;
  controller::law::Settings settings_;
  controller::SteppedLaw law_;
  Eigen::VectorXd plant_, torque_, limit_;  ///< state and torque at rest; torque limits
  Eigen::MatrixXd measured_;                ///< map from the plant's state to the law's measurement
  struct Arms;
  std::shared_ptr<Arms> arms_;  ///< one for each thread that is in a call
};

}  // namespace tachless::lyapunov

#include "plant/emulated_robot.h"

#include "robot/cholesky.h"
#include "robot/mass_matrix.h"

namespace tachless::plant {
namespace {

/// Velocity after a body at rest has become part of the robot: the joints' momentum stays.
robot::Vector after_impact(const robot::Model& before, const robot::Model& after,
                           const ArmState& state) {
  robot::Vector v = robot::mass_matrix(before, state.q) * state.v;
  robot::Matrix LD = robot::mass_matrix(after, state.q);
  robot::factorise(LD);
  robot::solve_in_place(LD, v);
  return v;
}

}  // namespace

EmulatedRobot::EmulatedRobot(const experiment::Scenario& scenario, const robot::Model& model)
    : scenario_(scenario),
      model_(&model),
      disturbances_(scenario, model),
      changes_(model_changes(scenario)),
      arm_(make_arm(scenario, model, initial_state(scenario, model), 0, outside())) {}

OutsideTorque* EmulatedRobot::outside() {
  return scenario_.plant.disturbances.empty() ? nullptr : &disturbances_;
}

ArmState EmulatedRobot::read() {
  ArmState state = arm_.state();
  if (outside() != nullptr) state.disturbance = disturbances_.at(now_s_, state.q);
  return state;
}

void EmulatedRobot::hold(const robot::Vector& tau, double until_s) {
  // A change at the end of a tick, but for rounding, is one at the beginning of the next.
  const double same_s = 1e-9 * scenario_.loop.period_s;
  while (num_changed_ < changes_.size() && changes_[num_changed_].at_s < until_s - same_s) {
    const ModelChange& change = changes_[num_changed_++];
    if (change.at_s > now_s_ + same_s) advance(tau, change.at_s);
    ArmState state = arm_.state();
    if (change.impact) state.v = after_impact(*model_, change.model, state);
    model_ = &change.model;
    arm_ = make_arm(scenario_, *model_, state, now_s_, outside());
  }
  advance(tau, until_s);
}

void EmulatedRobot::advance(const robot::Vector& tau, double until_s) {
  arm_.advance(tau, until_s);
  now_s_ = until_s;
}

void EmulatedRobot::stop() {
  arm_.brake(protective_stop_damping(scenario_, *model_, arm_.state().q));
}

void EmulatedRobot::rest(double until_s) {
  advance(robot::Vector::Zero(model_->num_joints), until_s);
}

}  // namespace tachless::plant

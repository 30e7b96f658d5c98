#include "plant/emulated_robot.h"

#include "plant/plant_model.h"

namespace tachless::plant {

EmulatedRobot::EmulatedRobot(const experiment::Scenario& scenario, const robot::Model& model)
    : scenario_(scenario), model_(model), arm_(make_arm(scenario, model)) {}

void EmulatedRobot::stop() {
  arm_.brake(protective_stop_damping(scenario_, model_, arm_.state().q));
}

void EmulatedRobot::rest(double until_s) {
  arm_.advance(robot::Vector::Zero(model_.num_joints), until_s);
}

}  // namespace tachless::plant

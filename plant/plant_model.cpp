#include "plant/plant_model.h"

#include <cmath>

#include "base/failure.h"
#include "robot/dynamics.h"

namespace tachless::plant {
namespace {

Vector or_zero(const Vector& x, int size) { return x.size() == 0 ? Vector(Vector::Zero(size)) : x; }

/// Returns the drives' torque until the first command acts.
Vector initial_torque(const InitialState& initial, const robot::Model& model, const Vector& q) {
  if (initial.torque_Nm.size() > 0) return initial.torque_Nm;
  if (initial.torque == InitialTorque::hold) return robot::gravity_torque(model, q);
  return Vector::Zero(q.size());
}

/// Returns that torque at the start of the run.
Vector first_torque(const InitialState& initial, const robot::Model& model) {
  return initial_torque(initial, model, or_zero(initial.position_rad, model.num_joints));
}

/// The mechanics of this library, with disturbances.
class ArmSimulator final : public Simulator {
 public:
  ArmSimulator(const Spec& plant, const Motors& motors, double period_s, const robot::Model& model)
      : disturbances_(plant.disturbances, period_s, model),
        arm_(make_arm(plant, motors, model, initial_state(plant, motors, model), &disturbances_)) {}

  void reset(const ArmState& initial) override { arm_.set_state(initial, now_s_ = 0); }
  ArmState state() override {
    ArmState state = arm_.state();
    state.disturbance = disturbances_.at(now_s_, state.q);
    return state;
  }
  void advance(const Vector& tau, double until_s) override { arm_.advance(tau, now_s_ = until_s); }
  void brake(const Vector& damping) override { arm_.brake(damping); }

 private:
  Disturbances disturbances_;
  Arm arm_;
  double now_s_ = 0;
};

}  // namespace

robot::Model unloaded_model(const scenario::Scenario& scenario) {
  robot::Model model = *scenario.model;
  if (!scenario.robot.flexible) {
    model.rotor_inertia = or_zero(scenario.robot.rigid_rotor_inertia_kgm2, model.num_joints);
  }
  return model;
}

robot::Model plant_model(const scenario::Scenario& scenario) {
  return scenario::with_payload(scenario, unloaded_model(scenario));
}

ArmState initial_state(const Spec& plant, const Motors& motors, const robot::Model& model) {
  const InitialState& initial = plant.initial;
  ArmState state;
  state.q = or_zero(initial.position_rad, model.num_joints);
  state.v = or_zero(initial.velocity_rad_per_s, model.num_joints);
  if (motors) {
    state.theta = initial.motor_position_rad.value_or(
        state.q + robot::gravity_torque(model, state.q).cwiseQuotient(motors->stiffness));
    state.thetadot = initial.motor_velocity_rad_per_s.value_or(Vector::Zero(model.num_joints));
  }
  if (plant.drive.current_loop_hz) state.torque = initial_torque(initial, model, state.q);
  return state;
}

Arm make_arm(const Spec& plant, const Motors& motors, const robot::Model& model,
             const ArmState& start, Disturbances* disturbances) {
  return Arm(model,
             {plant.mechanics, plant.integrator.accuracy, plant.drive, motors ? &*motors : nullptr,
              disturbances},
             start);
}

Drive make_drive(const Spec& plant, const scenario::LoopSpec& loop, const robot::Model& model) {
  return Drive(plant.drive, loop.command_delay, loop.period_s, first_torque(plant.initial, model));
}

Vector protective_stop_damping(const Motors& motors, const robot::Model& model, const Vector& q) {
  constexpr double time_constant_s = 0.1;
  Vector inertia = robot::mass_matrix(model, q).diagonal();
  if (motors) inertia += motors->rotor_inertia;
  return inertia / time_constant_s;
}

EmulatedRobot::EmulatedRobot(const Spec& plant, const Motors& motors, double period_s,
                             const robot::Model& model)
    : plant_(plant),
      motors_(motors),
      model_(model),
      own_(std::make_unique<ArmSimulator>(plant, motors, period_s, model)),
      simulator_(*own_),
      before_(first_torque(plant.initial, model)) {}

EmulatedRobot::EmulatedRobot(const Spec& plant, const Motors& motors, const robot::Model& model,
                             Simulator& simulator)
    : plant_(plant),
      motors_(motors),
      model_(model),
      simulator_(simulator),
      before_(first_torque(plant.initial, model)) {
  simulator_.reset(initial_state(plant, motors, model));
}

ArmState EmulatedRobot::read() {
  ArmState state = simulator_.state();
  const Eigen::Index n = model_.num_joints;
  if (state.q.size() != n || state.v.size() != n) {
    throw base::Failure(base::ExitCode::protective_stop,
                        "the simulator gave {} positions and {} velocities; the scenario has {} "
                        "joints: give ArmState as many numbers",
                        state.q.size(), state.v.size(), n);
  }
  return state;
}

void EmulatedRobot::hold(const Vector& tau, double until_s) {
  if (const double late = plant_.drive.delay_fraction; late > 0) {
    advance(before_, now_s_ + late * (until_s - now_s_));
  }
  advance(tau, until_s);
  before_ = tau;
}

void EmulatedRobot::advance(const Vector& tau, double until_s) {
  simulator_.advance(tau, until_s);
  now_s_ = until_s;
}

void EmulatedRobot::stop() {
  simulator_.brake(protective_stop_damping(motors_, model_, simulator_.state().q));
}

void EmulatedRobot::rest(double until_s) { advance(Vector::Zero(model_.num_joints), until_s); }

}  // namespace tachless::plant

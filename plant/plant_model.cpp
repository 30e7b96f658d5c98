#include "plant/plant_model.h"

#include <cmath>

#include "robot/dynamics.h"

namespace tachless::plant {
namespace {

Vector or_zero(const Vector& x, int size) { return x.size() == 0 ? Vector(Vector::Zero(size)) : x; }

/// Null for rigid joints.
const FlexibleDrive* flexible_drive(const scenario::Scenario& scenario) {
  return scenario.robot.flexible ? &*scenario.robot.flexible : nullptr;
}

/// Of the drives until the first command acts.
Vector initial_torque(const scenario::Scenario& scenario, const robot::Model& model,
                      const Vector& q) {
  if (scenario.plant.initial.torque_Nm.size() > 0) return scenario.plant.initial.torque_Nm;
  if (scenario.plant.initial.torque == InitialTorque::hold) return robot::gravity_torque(model, q);
  return Vector::Zero(q.size());
}

}  // namespace

robot::Model plant_model(const scenario::Scenario& scenario) {
  robot::Model model = *scenario.model;
  if (!scenario.robot.flexible) {
    model.rotor_inertia = or_zero(scenario.robot.rigid_rotor_inertia_kgm2, model.num_joints);
  }
  return scenario::with_payload(scenario, std::move(model));
}

ArmState initial_state(const scenario::Scenario& scenario, const robot::Model& model) {
  const InitialState& initial = scenario.plant.initial;
  ArmState state;
  state.q = or_zero(initial.position_rad, model.num_joints);
  state.v = or_zero(initial.velocity_rad_per_s, model.num_joints);
  if (const FlexibleDrive* drive = flexible_drive(scenario)) {
    state.theta = initial.motor_position_rad.value_or(
        state.q + robot::gravity_torque(model, state.q).cwiseQuotient(drive->stiffness));
    state.thetadot = initial.motor_velocity_rad_per_s.value_or(Vector::Zero(model.num_joints));
  }
  if (scenario.plant.drive.current_loop_hz) {
    state.torque = initial_torque(scenario, model, state.q);
  }
  return state;
}

Arm make_arm(const scenario::Scenario& scenario, const robot::Model& model, const ArmState& start,
             Disturbances* disturbances) {
  const Spec& spec = scenario.plant;
  return Arm(model,
             {spec.mechanics, spec.integrator.accuracy, spec.drive, flexible_drive(scenario),
              disturbances},
             start);
}

Drive make_drive(const scenario::Scenario& scenario, const robot::Model& model) {
  const Vector unlimited = Vector::Constant(model.num_joints, robot::Model::unlimited);
  const DriveSpec& spec = scenario.plant.drive;
  Vector change;
  if (spec.torque_rate_limit_Nm_per_s) {
    change = *spec.torque_rate_limit_Nm_per_s * scenario.loop.period_s;
  }
  return Drive(spec.torque_limit_Nm.value_or(unlimited), scenario.loop.command_delay, change,
               initial_torque(scenario, model, initial_state(scenario, model).q),
               spec.command_age_jitter_ticks, spec.seed);
}

Vector protective_stop_damping(const scenario::Scenario& scenario, const robot::Model& model,
                               const Vector& q) {
  constexpr double time_constant_s = 0.1;
  Vector inertia = robot::mass_matrix(model, q).diagonal();
  if (scenario.robot.flexible) inertia += scenario.robot.flexible->rotor_inertia;
  return inertia / time_constant_s;
}

EmulatedRobot::EmulatedRobot(const scenario::Scenario& scenario, const robot::Model& model)
    : scenario_(scenario),
      model_(model),
      disturbances_(scenario.plant.disturbances, scenario.loop.period_s, model),
      before_(initial_torque(scenario, model, initial_state(scenario, model).q)),
      arm_(make_arm(scenario, model, initial_state(scenario, model), &disturbances_)) {}

ArmState EmulatedRobot::read() {
  ArmState state = arm_.state();
  state.disturbance = disturbances_.at(now_s_, state.q);
  return state;
}

void EmulatedRobot::hold(const Vector& tau, double until_s) {
  if (const double late = scenario_.plant.drive.delay_fraction; late > 0) {
    advance(before_, now_s_ + late * (until_s - now_s_));
  }
  advance(tau, until_s);
  before_ = tau;
}

void EmulatedRobot::advance(const Vector& tau, double until_s) {
  arm_.advance(tau, until_s);
  now_s_ = until_s;
}

void EmulatedRobot::stop() {
  arm_.brake(protective_stop_damping(scenario_, model_, arm_.state().q));
}

void EmulatedRobot::rest(double until_s) { advance(Vector::Zero(model_.num_joints), until_s); }

}  // namespace tachless::plant

#include "plant/plant_model.h"

#include <optional>
#include <stdexcept>

#include "plant/stiffness.h"
#include "robot/inverse_dynamics.h"
#include "robot/mass_matrix.h"

namespace tachless::plant {
namespace {

robot::Vector or_zero(const robot::Vector& x, int size) {
  return x.size() == 0 ? robot::Vector(robot::Vector::Zero(size)) : x;
}

}  // namespace

robot::Model plant_model(const experiment::Scenario& scenario) {
  robot::Model model = *scenario.model;
  if (!scenario.robot.flexible) {
    model.rotor_inertia = or_zero(scenario.robot.rigid_rotor_inertia_kgm2, model.num_joints);
  }
  const PayloadSpec& payload = scenario.plant.payload;
  if (payload.mass_kg > 0) {
    try {
      model = robot::with_payload(std::move(model), payload.mass_kg, payload.link);
    } catch (const std::invalid_argument& error) {
      throw scenario.complaint("plant.payload", error.what());
    }
  }
  return model;
}

ArmState initial_state(const experiment::Scenario& scenario, const robot::Model& model) {
  const InitialState& initial = scenario.plant.initial;
  ArmState state;
  state.q = or_zero(initial.position_rad, model.num_joints);
  state.v = or_zero(initial.velocity_rad_per_s, model.num_joints);
  if (const std::optional<FlexibleDrive>& drive = scenario.robot.flexible; drive) {
    state.theta =
        initial.motor_position_rad
            ? *initial.motor_position_rad
            : robot::Vector(state.q +
                            robot::gravity_torque(model, state.q).cwiseQuotient(drive->stiffness));
    state.thetadot = initial.motor_velocity_rad_per_s
                         ? *initial.motor_velocity_rad_per_s
                         : robot::Vector(robot::Vector::Zero(model.num_joints));
  }
  return state;
}

Arm make_arm(const experiment::Scenario& scenario, const robot::Model& model) {
  const std::optional<FlexibleDrive>& drive = scenario.robot.flexible;
  ArmOptions options;
  options.flexible = drive ? &*drive : nullptr;
  options.viscous_friction = scenario.plant.drive.viscous_friction_Nms_per_rad;
  options.mechanics = scenario.plant.mechanics;
  options.integrator = scenario.plant.integrator.method;
  options.accuracy = scenario.plant.integrator.accuracy;
  return Arm(model, options, initial_state(scenario, model));
}

Drive make_drive(const experiment::Scenario& scenario, const robot::Model& model) {
  const robot::Vector unlimited =
      robot::Vector::Constant(model.num_joints, robot::Model::unlimited);
  return Drive(scenario.plant.drive.torque_limit_Nm.value_or(unlimited),
               scenario.loop.command_delay);
}

robot::Vector protective_stop_damping(const experiment::Scenario& scenario,
                                      const robot::Model& model, const robot::Vector& q) {
  constexpr double time_constant_s = 0.1;
  robot::Vector inertia = robot::mass_matrix(model, q).diagonal();
  if (scenario.robot.flexible) inertia += scenario.robot.flexible->rotor_inertia;
  return inertia / time_constant_s;
}

double integrator_steps_per_tick(const experiment::Scenario& scenario, const robot::Model& model) {
  const std::optional<FlexibleDrive>& drive = scenario.robot.flexible;
  const double rate =
      fastest_rate(robot::mass_matrix(model, initial_state(scenario, model).q),
                   drive ? &*drive : nullptr, scenario.plant.drive.viscous_friction_Nms_per_rad);
  return integrator_steps(scenario.plant.integrator.method, rate, scenario.loop.period_s);
}

}  // namespace tachless::plant

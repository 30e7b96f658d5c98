#include "plant/plant_model.h"

#include <Eigen/LU>
#include <stdexcept>

#include "plant/stiffness.h"
#include "robot/inverse_dynamics.h"
#include "robot/mass_matrix.h"

namespace tachless::plant {
namespace {

robot::Vector or_zero(const robot::Vector& x, int size) {
  return x.size() == 0 ? robot::Vector(robot::Vector::Zero(size)) : x;
}

robot::Model without_payload(const experiment::Scenario& scenario) {
  robot::Model model = *scenario.model;
  if (!scenario.robot.flexible) {
    model.rotor_inertia = or_zero(scenario.robot.rigid_rotor_inertia_kgm2, model.num_joints);
  }
  return model;
}

}  // namespace

robot::Model plant_model(const experiment::Scenario& scenario) {
  robot::Model model = without_payload(scenario);
  if (scenario.plant.payload.attach_s > 0) return model;
  return experiment::with_payload(scenario, std::move(model));
}

std::vector<ModelChange> model_changes(const experiment::Scenario& scenario) {
  std::vector<ModelChange> changes;
  const PayloadSpec& payload = scenario.plant.payload;
  if (payload.mass_kg == 0) return changes;
  const robot::Model alone = without_payload(scenario);
  if (payload.attach_s > 0) {
    changes.push_back({payload.attach_s, experiment::with_payload(scenario, alone), true});
  }
  if (payload.release_s) changes.push_back({*payload.release_s, alone, false});
  return changes;
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

Arm make_arm(const experiment::Scenario& scenario, const robot::Model& model, const ArmState& start,
             double start_s, OutsideTorque* outside) {
  const std::optional<FlexibleDrive>& drive = scenario.robot.flexible;
  const DriveSpec& joints = scenario.plant.drive;
  ArmOptions options;
  options.outside = outside;
  options.start_s = start_s;
  if (joints.dry_friction()) {
    options.coulomb_friction = joints.coulomb_friction_Nm;
    options.static_friction = joints.static_friction_Nm.value_or(joints.coulomb_friction_Nm);
    options.stribeck_velocity = joints.stribeck_velocity_rad_per_s;
  }
  options.flexible = drive ? &*drive : nullptr;
  options.viscous_friction = joints.viscous_friction_Nms_per_rad;
  options.mechanics = scenario.plant.mechanics;
  options.integrator = scenario.plant.integrator.method;
  options.accuracy = scenario.plant.integrator.accuracy;
  return Arm(model, options, start);
}

Drive make_drive(const experiment::Scenario& scenario, const robot::Model& model) {
  const robot::Vector unlimited =
      robot::Vector::Constant(model.num_joints, robot::Model::unlimited);
  const DriveSpec& spec = scenario.plant.drive;
  robot::Vector change;
  if (spec.torque_rate_limit_Nm_per_s) {
    change = *spec.torque_rate_limit_Nm_per_s * scenario.loop.period_s;
  }
  return Drive(spec.torque_limit_Nm.value_or(unlimited), scenario.loop.command_delay, change);
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

std::optional<std::size_t> stiff_friction(const experiment::Scenario& scenario,
                                          const robot::Model& model, double steps) {
  const robot::Vector& friction = scenario.plant.drive.viscous_friction_Nms_per_rad;
  if (friction.size() == 0) return {};
  const robot::Matrix inverse =
      robot::mass_matrix(model, initial_state(scenario, model).q).inverse();
  Eigen::Index joint = 0;
  const double rate = friction.cwiseProduct(inverse.diagonal()).maxCoeff(&joint);
  if (integrator_steps(scenario.plant.integrator.method, rate, scenario.loop.period_s) <= steps) {
    return {};
  }
  return static_cast<std::size_t>(joint);
}

}  // namespace tachless::plant

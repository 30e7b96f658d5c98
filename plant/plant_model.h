#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "experiment/scenario.h"
#include "plant/arm.h"
#include "plant/drive.h"
#include "robot/model.h"

/// What a scenario means for the plant.
namespace tachless::plant {

/// The true robot at the start of the run: URDF, gravity, rotor inertia of rigid joints, and the
/// payload that the controller does not know, unless it is attached later.
/// @throw diagnostics::Failure(bad_usage) naming the key.
robot::Model plant_model(const experiment::Scenario& scenario);

/// The robot from an instant of the run on.
struct ModelChange {
  double at_s;
  robot::Model model;
  bool impact;  ///< what comes was at rest: M v stays, v jumps; else v stays
};
/// The payload's coming and going during the run, in order.
std::vector<ModelChange> model_changes(const experiment::Scenario& scenario);

/// Where the run starts. Motors start, unless given, at rest in static balance:
/// theta = q + K^-1 g(q).
ArmState initial_state(const experiment::Scenario& scenario, const robot::Model& model);

/// The arm of the scenario at `start` and its time. `model` is its model from then on; `outside`,
/// if not null, outlives the arm.
Arm make_arm(const experiment::Scenario& scenario, const robot::Model& model, const ArmState& start,
             double start_s = 0, OutsideTorque* outside = nullptr);
/// The same from the initial state on.
inline Arm make_arm(const experiment::Scenario& scenario, const robot::Model& model) {
  return make_arm(scenario, model, initial_state(scenario, model));
}

/// The drives: the scenario's torque limit (which defaults to the URDF's), rate and command delay.
Drive make_drive(const experiment::Scenario& scenario, const robot::Model& model);

/// Viscous braking of the protective stop [N m s/rad]: each joint's inertia at `q` (seen by its
/// drive) over 0.1 s, so that the joint comes to rest in some tenths of a second.
robot::Vector protective_stop_damping(const experiment::Scenario& scenario,
                                      const robot::Model& model, const robot::Vector& q);

/// Integrator steps that one tick of this scenario takes for stability alone, from its fastest
/// mode at the initial state; see plant/stiffness.h. Worth a warning from about 100 on:
/// "stiffness … at period … needs about N integrator steps a tick".
double integrator_steps_per_tick(const experiment::Scenario& scenario, const robot::Model& model);

/// The joint whose viscous friction decays fastest against its inertia at the initial state, if the
/// integrator takes more than `steps` steps a tick for that alone.
std::optional<std::size_t> stiff_friction(const experiment::Scenario& scenario,
                                          const robot::Model& model, double steps);

}  // namespace tachless::plant

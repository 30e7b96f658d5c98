#pragma once

#include <memory>

#include "plant/simulator.h"
#include "robot/model.h"
#include "scenario/scenario.h"

/// MuJoCo's mechanics in place of the emulator's mechanics (plant.mujoco). A module that is opened
/// at run time links MuJoCo, so that no program needs it.
namespace tachless::plant {

/// Returns whether the module is installed.
bool has_mujoco_module();

/// Returns the simulator of plant.mujoco. First compares the inertia matrix and gravity torque with
/// those of `model`, at the initial posture and ten others.
/// @throw base::Failure(bad_usage) without the module, for a model that does not fit, and for other
/// mechanics unless plant.mujoco.may_differ
std::unique_ptr<Simulator> mujoco_simulator(const scenario::Scenario& scenario,
                                            const robot::Model& model);

}  // namespace tachless::plant

#pragma once

#include "plant/arm.h"
#include "robot/quantities.h"

/// How many steps a tick must cost an integrator because something in the plant is fast.
namespace tachless::plant {

/// Magnitude of the fastest eigenvalue [rad/s] of the arm linearised about rest, gravity left out:
/// springs, rotors and viscous friction. `M` is the links' inertia matrix (rotors of rigid joints
/// included); `flexible` is null for rigid joints.
double fastest_rate(const robot::Matrix& M, const FlexibleDrive* flexible,
                    const robot::Vector& viscous_friction);

/// Fewest steps in which `method` can cross `interval_s` without being unstable on that eigenvalue:
/// interval times rate over the extent of the method's stability region along the imaginary axis.
/// Accuracy may ask for more. 1 for cpodes, whose implicit formulas have no such bound.
double integrator_steps(Integrator method, double rate, double interval_s);

}  // namespace tachless::plant

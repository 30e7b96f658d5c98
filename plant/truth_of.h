#pragma once

#include "loop/truth/plant_truth.h"
#include "plant/arm.h"
#include "plant/drive.h"

namespace tachless::plant {

/// TRUTH of a tick without a fault: the state at its beginning and the torque over it.
inline loop::truth::PlantTruth truth_of(const ArmState& state, const AppliedTorque& applied) {
  loop::truth::PlantTruth truth;
  truth.q = state.q;
  truth.v = state.v;
  truth.theta = state.theta;
  truth.thetadot = state.thetadot;
  truth.tau = applied.tau;
  truth.disturbance = state.disturbance;
  if (truth.disturbance.size() == 0) truth.disturbance.setZero(state.q.size());
  truth.saturated = applied.saturated;
  return truth;
}

}  // namespace tachless::plant

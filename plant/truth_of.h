#pragma once

#include "messages/truth/plant_truth.h"
#include "plant/arm_state.h"
#include "plant/drive.h"

namespace tachless::plant {

/// Returns the TRUTH of a tick without a fault: the state at its beginning and the torque over it.
inline messages::truth::PlantTruth truth_of(const ArmState& state, const AppliedTorque& applied) {
  messages::truth::PlantTruth truth{state.q,          state.v,     state.theta,
                                    state.thetadot,   applied.tau, state.disturbance,
                                    applied.saturated};
  if (truth.disturbance.size() == 0) truth.disturbance.setZero(state.q.size());
  return truth;
}

}  // namespace tachless::plant

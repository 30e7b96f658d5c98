#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "experiment/scenario.h"
#include "loop/messages.h"
#include "loop/truth/plant_truth.h"
#include "plant/arm_state.h"
#include "plant/drive.h"

/// The messages that describe a run, on the bus or in one process. Publishes nothing.
namespace tachless::plant {

/// RUN_INFO of a run, as it is published and logged.
/// @param law as the controller announces it
/// @throw diagnostics::Failure(bad_usage) when scenario and URDF are too long for one message.
std::vector<std::byte> run_info(const experiment::Scenario& scenario, std::int64_t run,
                                const loop::LawInfo& law);

/// TRUTH of a tick without a fault: the state at its beginning and the torque over it.
inline loop::truth::PlantTruth truth_of(const ArmState& state, const AppliedTorque& applied) {
  loop::truth::PlantTruth truth{state.q,     state.v,           state.theta,      state.thetadot,
                                applied.tau, state.disturbance, applied.saturated};
  if (truth.disturbance.size() == 0) truth.disturbance.setZero(state.q.size());
  return truth;
}

}  // namespace tachless::plant

#pragma once

#include <optional>

#include "messages/truth/arm_torque.h"
#include "messages/truth/contact.h"
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

/// Returns the CONTACT of a tick.
inline messages::truth::Contact contact_of(const ArmState& state) {
  const Contact contact = state.contact.value_or(Contact());
  constexpr std::size_t longest = messages::truth::Contact::longest_name;
  return {contact.simulator.substr(0, longest), contact.geoms.substr(0, longest), contact.force};
}

/// Returns the ARM_TORQUE of a tick; nothing if the arm tells no torque.
inline std::optional<messages::truth::ArmTorque> arm_torque_of(const ArmState& state) {
  using messages::truth::Told;
  const bool accepted = state.accepted.size() != 0, measured = state.measured.size() != 0;
  if (!accepted && !measured) return std::nullopt;
  const Vector zero = Vector::Zero(state.q.size());
  return messages::truth::ArmTorque{accepted ? state.accepted : zero,
                                    measured ? state.measured : zero,
                                    accepted && measured ? Told::both
                                    : accepted           ? Told::accepted
                                                         : Told::measured};
}

}  // namespace tachless::plant

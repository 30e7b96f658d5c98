#pragma once

#include "messages/truth/arm_torque.h"
#include "messages/truth/contact.h"
#include "messages/truth/plant_truth.h"
#include "messages/wire.h"

/// Ground truth as bytes: codecs of `PlantTruth`, `Contact` and `ArmTorque`. The target is
/// separate, and no target of controller/ links to it.
namespace tachless::messages {

template <>
std::int64_t fingerprint<messages::truth::PlantTruth>();
template <>
std::int64_t fingerprint<messages::truth::Contact>();
template <>
std::int64_t fingerprint<messages::truth::ArmTorque>();

extern template class Codec<messages::truth::PlantTruth>;
extern template class Codec<messages::truth::Contact>;
extern template class Codec<messages::truth::ArmTorque>;

}  // namespace tachless::messages

#pragma once

#include "messages/truth/plant_truth.h"
#include "messages/wire.h"

/// Ground truth on the wire: `Codec<messages::truth::PlantTruth>`. A target of its own; no target
/// of controller/ links to it.
namespace tachless::messages {

template <>
std::int64_t fingerprint<messages::truth::PlantTruth>();

extern template class Codec<messages::truth::PlantTruth>;

}  // namespace tachless::messages

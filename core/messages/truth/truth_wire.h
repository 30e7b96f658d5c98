#pragma once

#include "messages/truth/plant_truth.h"
#include "messages/wire.h"

/// Ground truth as bytes: `Codec<messages::truth::PlantTruth>`. The target is separate, and no
/// target of controller/ links to it.
namespace tachless::messages {

template <>
std::int64_t fingerprint<messages::truth::PlantTruth>();

extern template class Codec<messages::truth::PlantTruth>;

}  // namespace tachless::messages

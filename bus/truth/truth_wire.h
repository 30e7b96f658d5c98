#pragma once

#include "bus/wire.h"
#include "loop/truth/plant_truth.h"

/// Ground truth on the wire: `Codec<loop::truth::PlantTruth>`. A target of its own; no target of
/// controller/ links to it.
namespace tachless::bus {

template <>
std::int64_t fingerprint<loop::truth::PlantTruth>();

extern template class Codec<loop::truth::PlantTruth>;

}  // namespace tachless::bus

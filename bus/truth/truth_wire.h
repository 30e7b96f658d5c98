#pragma once

#include "bus/wire.h"
#include "loop/truth/plant_truth.h"

/// Ground truth on the wire: `Codec<loop::truth::PlantTruth>`. A target of its own; no target of
/// controller/ links to it.
namespace tachless {

template <>
struct loop::ChannelOf<loop::truth::PlantTruth> {
  static constexpr std::string_view suffix = "TRUTH";
};

namespace bus {

/// True when no number in the value is NaN or infinite.
bool all_finite(const loop::truth::PlantTruth& value);

extern template class Codec<loop::truth::PlantTruth>;

}  // namespace bus
}  // namespace tachless

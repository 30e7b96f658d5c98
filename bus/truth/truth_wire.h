#pragma once

#include "bus/truth/plant_truth.h"
#include "bus/wire.h"

/// Ground truth on the wire: `Codec<truth::PlantTruth>`. A target of its own; no target of
/// controller/ links to it.
namespace bus {

namespace truth {
/// True when no number in the value is NaN or infinite.
bool all_finite(const PlantTruth& value);
}  // namespace truth

template <>
struct ChannelOf<truth::PlantTruth> {
  static constexpr std::string_view suffix = "TRUTH";
};

extern template class Codec<truth::PlantTruth>;

}  // namespace bus

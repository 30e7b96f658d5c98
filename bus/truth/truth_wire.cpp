#include "bus/truth/truth_wire.h"

#include <tachless_truth/plant_truth_t.hpp>

#include "bus/codec.h"

namespace tachless::bus {

template <>
std::int64_t fingerprint<loop::truth::PlantTruth>() {
  return tachless_truth::plant_truth_t::getHash();
}

template class Codec<loop::truth::PlantTruth>;
template std::optional<loop::Layout> announced_layout<loop::truth::PlantTruth>(
    std::span<const std::byte>);

}  // namespace tachless::bus

#include "messages/truth/truth_wire.h"

#include <tachless_truth/arm_torque_t.hpp>
#include <tachless_truth/contact_t.hpp>
#include <tachless_truth/plant_truth_t.hpp>

#include "messages/codec.h"

namespace tachless::messages {

template <>
std::int64_t fingerprint<messages::truth::PlantTruth>() {
  return tachless_truth::plant_truth_t::getHash();
}

template <>
std::int64_t fingerprint<messages::truth::Contact>() {
  return tachless_truth::contact_t::getHash();
}

template <>
std::int64_t fingerprint<messages::truth::ArmTorque>() {
  return tachless_truth::arm_torque_t::getHash();
}

template class Codec<messages::truth::PlantTruth>;
template class Codec<messages::truth::Contact>;
template class Codec<messages::truth::ArmTorque>;
template std::optional<messages::Layout> announced_layout<messages::truth::PlantTruth>(
    std::span<const std::byte>);
template std::optional<messages::Layout> announced_layout<messages::truth::Contact>(
    std::span<const std::byte>);
template std::optional<messages::Layout> announced_layout<messages::truth::ArmTorque>(
    std::span<const std::byte>);

}  // namespace tachless::messages

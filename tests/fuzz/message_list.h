#pragma once

#include <type_traits>

#include "messages/messages.h"
#include "messages/truth/arm_torque.h"
#include "messages/truth/contact.h"
#include "messages/truth/plant_truth.h"

/// The numbered message types that the fuzzers know. The first byte of an input selects one.
namespace tachless::fuzz {

template <class... Value>
messages::TypeList<Value..., messages::truth::PlantTruth, messages::truth::Contact,
                   messages::truth::ArmTorque>
    with_truth(messages::TypeList<Value...>);
using Messages = decltype(with_truth(messages::Messages()));

template <class Value>
constexpr int number_of() {
  int number = -1;
  int next = 0;
  for_each_type(Messages(), [&]<class Other>(std::type_identity<Other>) {
    if (std::is_same_v<Other, Value>) number = next;
    ++next;
  });
  return number;
}

}  // namespace tachless::fuzz

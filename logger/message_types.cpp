#include "logger/message_types.h"

#include "bus/truth/truth_wire.h"
#include "bus/wire.h"

namespace tachless::logger {

std::string_view type_name(std::span<const std::byte> message) {
  const auto found = bus::fingerprint_of(message);
  std::string_view name;
  const auto compare = [&]<class Value>(std::type_identity<Value>) {
    if (found == bus::fingerprint<Value>()) name = loop::MessageOf<Value>::type;
  };
  for_each_type(loop::Messages(), compare);
  compare(std::type_identity<loop::truth::PlantTruth>());
  return name;
}

}  // namespace tachless::logger

#include "logger/message_types.h"

#include <algorithm>
#include <array>
#include <vector>

#include "bus/truth/truth_wire.h"
#include "bus/wire.h"

namespace tachless::logger {
namespace {

struct TypeName {
  std::array<std::byte, 8> fingerprint;
  std::string_view name;
};

template <class Value>
TypeName entry(std::string_view name, const Value& value) {
  bus::Codec<Value> codec(loop::Layout{1, 0, 0});
  const auto bytes = codec.encode({}, value);
  TypeName type{{}, name};
  std::copy_n(bytes.begin(), type.fingerprint.size(), type.fingerprint.begin());
  return type;
}

/// The fingerprints of our types, read off what the codecs write.
std::vector<TypeName> read_off() {
  const robot::Vector x = robot::Vector::Zero(1);
  const robot::Vector none;
  loop::truth::PlantTruth truth;
  truth.q = truth.v = truth.tau = x;
  return {entry("tachless.tick_t", loop::Tick{}),
          entry("tachless.position_measurement_t", loop::PositionMeasurement{x}),
          entry("tachless.motor_position_measurement_t", loop::MotorPositionMeasurement{x}),
          entry("tachless.link_state_measurement_t", loop::LinkStateMeasurement{x, x, x}),
          entry("tachless.state_measurement_t", loop::StateMeasurement{x, x, none, none}),
          entry("tachless.reference_t", loop::ReferencePoint{x, x, x, x, x}),
          entry("tachless.torque_command_t", loop::TorqueCommand{x}),
          entry("tachless.controller_state_t", loop::LawSignals{}),
          entry("tachless.participant_t", loop::Participant{}),
          entry("tachless.run_info_t", loop::RunInfo{1, 1.0, {}, {}, {}, {}, {}, {}}),
          entry("tachless.log_ack_t", loop::LogAck{}),
          entry("tachless_truth.plant_truth_t", truth)};
}

}  // namespace

std::string_view type_name(std::span<const std::byte> message) {
  static const std::vector<TypeName> types = read_off();
  for (const auto& type : types) {
    if (message.size() >= type.fingerprint.size() &&
        std::equal(type.fingerprint.begin(), type.fingerprint.end(), message.begin())) {
      return type.name;
    }
  }
  return {};
}

}  // namespace tachless::logger

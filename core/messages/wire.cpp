#include "messages/wire.h"

#include <array>
#include <tachless/both_positions_measurement_t.hpp>
#include <tachless/controller_state_t.hpp>
#include <tachless/gains_ack_t.hpp>
#include <tachless/gains_t.hpp>
#include <tachless/link_state_measurement_t.hpp>
#include <tachless/log_ack_t.hpp>
#include <tachless/motor_position_measurement_t.hpp>
#include <tachless/participant_t.hpp>
#include <tachless/position_measurement_t.hpp>
#include <tachless/reference_t.hpp>
#include <tachless/run_info_t.hpp>
#include <tachless/state_measurement_t.hpp>
#include <tachless/tick_t.hpp>
#include <tachless/torque_command_t.hpp>

#include "messages/codec.h"

namespace tachless::messages {

std::string_view name(Rejection rejection) {
  static constexpr std::array<std::string_view, 7> names = {
      "none", "wrong_size", "wrong_type", "wrong_count", "non_finite", "bad_text", "bad_value"};
  return names.at(static_cast<std::size_t>(rejection));
}

std::optional<std::int64_t> fingerprint_of(std::span<const std::byte> payload) {
  if (payload.size() < sizeof(std::int64_t)) return {};
  return detail::Reader(payload).int64();
}

messages::Stamp stamp_of(std::span<const std::byte> payload) {
  if (payload.size() < stamp_end) {
    throw std::logic_error(fmt::format("bus: a message of {} bytes has no stamp", payload.size()));
  }
  detail::Reader from(payload.subspan(sizeof(std::int64_t)));
  const std::int64_t utime = from.int64();
  const std::int64_t run = from.int64();
  return {utime, run, from.int64()};
}

/// Type that lcm-gen generates. Only this file uses it, and only for its hash.
template <class Value>
struct Generated;

template <class Value>
std::int64_t fingerprint() {
  return Generated<Value>::Type::getHash();
}

Codec<messages::AnyMeasurement>::Codec(std::string_view suffix, const messages::Layout& layout)
    : codec_(std::visit([&]<class M>(const M& /*type*/)
                            -> messages::EachMeasurement<Codec> { return Codec<M>(layout); },
                        messages::measurement_of(suffix).value())) {}

std::size_t Codec<messages::AnyMeasurement>::longest() const {
  return std::visit([](const auto& codec) { return codec.longest(); }, codec_);
}

std::span<const std::byte> Codec<messages::AnyMeasurement>::encode(
    const messages::Stamp& stamp, const messages::AnyMeasurement& value) {
  return std::visit(
      [&]<class M>(Codec<M>& codec) { return codec.encode(stamp, std::get<M>(value)); }, codec_);
}

Rejection Codec<messages::AnyMeasurement>::decode(std::span<const std::byte> payload,
                                                  messages::Stamp& stamp,
                                                  messages::AnyMeasurement& value) const {
  return std::visit(
      [&]<class M>(const Codec<M>& codec) {
        if (std::holds_alternative<M>(value)) {
          return codec.decode(payload, stamp, std::get<M>(value));
        }
        M fresh;
        const Rejection rejection = codec.decode(payload, stamp, fresh);
        if (rejection == Rejection::none) value = std::move(fresh);
        return rejection;
      },
      codec_);
}

#define TACHLESS_MESSAGE(Value, type)                                         \
  template <>                                                                 \
  struct Generated<messages::Value> {                                         \
    using Type = type;                                                        \
  };                                                                          \
  template std::int64_t fingerprint<messages::Value>();                       \
  template class Codec<messages::Value>;                                      \
  template std::optional<messages::Layout> announced_layout<messages::Value>( \
      std::span<const std::byte>);
TACHLESS_MESSAGE(Tick, tick_t)
TACHLESS_MESSAGE(PositionMeasurement, position_measurement_t)
TACHLESS_MESSAGE(MotorPositionMeasurement, motor_position_measurement_t)
TACHLESS_MESSAGE(BothPositionsMeasurement, both_positions_measurement_t)
TACHLESS_MESSAGE(LinkStateMeasurement, link_state_measurement_t)
TACHLESS_MESSAGE(StateMeasurement, state_measurement_t)
TACHLESS_MESSAGE(ReferencePoint, reference_t)
TACHLESS_MESSAGE(TorqueCommand, torque_command_t)
TACHLESS_MESSAGE(LawSignals, controller_state_t)
TACHLESS_MESSAGE(Participant, participant_t)
TACHLESS_MESSAGE(RunInfo, run_info_t)
TACHLESS_MESSAGE(LogAck, log_ack_t)
TACHLESS_MESSAGE(GainChange, gains_t)
TACHLESS_MESSAGE(GainAck, gains_ack_t)
#undef TACHLESS_MESSAGE

}  // namespace tachless::messages

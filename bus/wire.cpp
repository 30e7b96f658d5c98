#include "bus/wire.h"

#include <array>

#include "bus/codec.h"

namespace tachless::bus {

std::string_view name(Rejection rejection) {
  static constexpr std::array<std::string_view, 7> names = {
      "none", "wrong_size", "wrong_type", "wrong_count", "non_finite", "bad_text", "bad_value"};
  return names.at(static_cast<std::size_t>(rejection));
}

std::optional<std::int64_t> fingerprint_of(std::span<const std::byte> payload) {
  if (payload.size() < sizeof(std::int64_t)) return {};
  return detail::Reader(payload).int64();
}

loop::Stamp stamp_of(std::span<const std::byte> payload) {
  if (payload.size() < stamp_end) {
    throw std::logic_error(fmt::format("bus: a message of {} bytes has no stamp", payload.size()));
  }
  detail::Reader from(payload.subspan(sizeof(std::int64_t)));
  const std::int64_t utime = from.int64();
  const std::int64_t run = from.int64();
  return {utime, run, from.int64()};
}

#define TACHLESS_INSTANTIATE(Value)  \
  template class Codec<loop::Value>; \
  template std::optional<loop::Layout> announced_layout<loop::Value>(std::span<const std::byte>);
TACHLESS_INSTANTIATE(Tick)
TACHLESS_INSTANTIATE(PositionMeasurement)
TACHLESS_INSTANTIATE(MotorPositionMeasurement)
TACHLESS_INSTANTIATE(LinkStateMeasurement)
TACHLESS_INSTANTIATE(StateMeasurement)
TACHLESS_INSTANTIATE(ReferencePoint)
TACHLESS_INSTANTIATE(TorqueCommand)
TACHLESS_INSTANTIATE(LawSignals)
TACHLESS_INSTANTIATE(Participant)
TACHLESS_INSTANTIATE(RunInfo)
TACHLESS_INSTANTIATE(LogAck)
#undef TACHLESS_INSTANTIATE

}  // namespace tachless::bus

#include <tachless/controller_state_t.hpp>
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

#include "bus/wire.h"

/// The one place that looks into the code that lcm-gen makes.
namespace tachless::bus {

template <class Value>
struct Generated;

template <class Value>
std::int64_t fingerprint() {
  return Generated<Value>::Type::getHash();
}

#define TACHLESS_GENERATED(Value, type) \
  template <>                           \
  struct Generated<loop::Value> {       \
    using Type = type;                  \
  };                                    \
  template std::int64_t fingerprint<loop::Value>();
TACHLESS_GENERATED(Tick, tick_t)
TACHLESS_GENERATED(PositionMeasurement, position_measurement_t)
TACHLESS_GENERATED(MotorPositionMeasurement, motor_position_measurement_t)
TACHLESS_GENERATED(LinkStateMeasurement, link_state_measurement_t)
TACHLESS_GENERATED(StateMeasurement, state_measurement_t)
TACHLESS_GENERATED(ReferencePoint, reference_t)
TACHLESS_GENERATED(TorqueCommand, torque_command_t)
TACHLESS_GENERATED(LawSignals, controller_state_t)
TACHLESS_GENERATED(Participant, participant_t)
TACHLESS_GENERATED(RunInfo, run_info_t)
TACHLESS_GENERATED(LogAck, log_ack_t)
#undef TACHLESS_GENERATED

}  // namespace tachless::bus

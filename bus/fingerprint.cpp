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

template <>
std::int64_t fingerprint<loop::Tick>() {
  return tick_t::getHash();
}
template <>
std::int64_t fingerprint<loop::PositionMeasurement>() {
  return position_measurement_t::getHash();
}
template <>
std::int64_t fingerprint<loop::MotorPositionMeasurement>() {
  return motor_position_measurement_t::getHash();
}
template <>
std::int64_t fingerprint<loop::LinkStateMeasurement>() {
  return link_state_measurement_t::getHash();
}
template <>
std::int64_t fingerprint<loop::StateMeasurement>() {
  return state_measurement_t::getHash();
}
template <>
std::int64_t fingerprint<loop::ReferencePoint>() {
  return reference_t::getHash();
}
template <>
std::int64_t fingerprint<loop::TorqueCommand>() {
  return torque_command_t::getHash();
}
template <>
std::int64_t fingerprint<loop::LawSignals>() {
  return controller_state_t::getHash();
}
template <>
std::int64_t fingerprint<loop::Participant>() {
  return participant_t::getHash();
}
template <>
std::int64_t fingerprint<loop::RunInfo>() {
  return run_info_t::getHash();
}
template <>
std::int64_t fingerprint<loop::LogAck>() {
  return log_ack_t::getHash();
}

}  // namespace tachless::bus

#include "bus/wire.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
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

#include "bus/codec.h"

namespace tachless::bus {
namespace {

using Kind = Field::Kind;

std::optional<loop::Role> role_named(std::string_view text) {
  for (int i = 0; i < loop::num_roles; ++i) {
    const auto role = static_cast<loop::Role>(i);
    if (name(role) == text) return role;
  }
  return std::nullopt;
}

void require_text(const std::string& text, std::size_t max_characters, const char* what) {
  if (text.find('\0') != std::string::npos) {
    throw std::logic_error(std::string("bus::Codec: NUL inside the text ") + what);
  }
  if (text.size() > max_characters) {
    throw std::length_error(std::string("bus::Codec: text ") + what + " has " +
                            std::to_string(text.size()) + " characters, allowed are " +
                            std::to_string(max_characters));
  }
}

}  // namespace

std::string_view name(Rejection rejection) {
  switch (rejection) {
    case Rejection::none:
      return "none";
    case Rejection::wrong_size:
      return "wrong_size";
    case Rejection::wrong_type:
      return "wrong_type";
    case Rejection::wrong_count:
      return "wrong_count";
    case Rejection::non_finite:
      return "non_finite";
    case Rejection::bad_text:
      return "bad_text";
    case Rejection::bad_value:
      return "bad_value";
  }
  throw std::logic_error("bus::name: no such rejection");
}

loop::Stamp stamp_of(std::span<const std::byte> payload) {
  std::array<std::int64_t, 3> values{};
  constexpr std::size_t fingerprint_size = stamp_end - sizeof values;
  if (payload.size() < stamp_end) {
    throw std::logic_error("bus: a message of " + std::to_string(payload.size()) +
                           " bytes has no stamp");
  }
  for (std::size_t i = 0; i < sizeof values; ++i) {
    std::int64_t& value = values[i / sizeof(std::int64_t)];
    value =
        static_cast<std::int64_t>(static_cast<std::uint64_t>(value) << 8 |
                                  std::to_integer<std::uint64_t>(payload[fingerprint_size + i]));
  }
  return {values[0], values[1], values[2]};
}

bool all_finite(const loop::Tick&) { return true; }
bool all_finite(const loop::PositionMeasurement& value) { return value.q.allFinite(); }
bool all_finite(const loop::MotorPositionMeasurement& value) { return value.theta.allFinite(); }
bool all_finite(const loop::LinkStateMeasurement& value) {
  return value.q.allFinite() && value.v.allFinite() && value.theta.allFinite();
}
bool all_finite(const loop::StateMeasurement& value) {
  return value.q.allFinite() && value.v.allFinite() && value.theta.allFinite() &&
         value.thetadot.allFinite();
}
bool all_finite(const loop::ReferencePoint& value) {
  return value.q_ref.allFinite() && value.v_ref.allFinite() && value.a_ref.allFinite() &&
         value.jerk_ref.allFinite() && value.snap_ref.allFinite();
}
bool all_finite(const loop::TorqueCommand& value) { return value.tau.allFinite(); }
bool all_finite(const loop::LawSignals& value) {
  return std::all_of(value.value.begin(), value.value.end(),
                     [](const robot::Vector& row) { return row.allFinite(); });
}
bool all_finite(const loop::Participant& value) { return std::isfinite(value.error_norm); }
bool all_finite(const loop::RunInfo& value) { return std::isfinite(value.period_s); }
bool all_finite(const loop::LogAck&) { return true; }

template <>
struct Translation<loop::Tick> {
  using Message = tachless::tick_t;
  static MessageShape shape(const loop::Layout&) { return {Message::getHash(), {{Kind::boolean}}}; }
  static void size(const loop::Layout&, Message&) {}
  static void write(const loop::Tick& value, const loop::Layout&, Message& message) {
    message.last = value.last ? 1 : 0;
  }
  static Rejection check(const Message&) { return Rejection::none; }
  static void read(const Message& message, loop::Tick& value) { value.last = message.last != 0; }
};

template <>
struct Translation<loop::PositionMeasurement> {
  using Message = tachless::position_measurement_t;
  static MessageShape shape(const loop::Layout& layout) {
    require_joints(layout);
    const int n = layout.num_joints;
    return {Message::getHash(), {{Kind::count, n}, {Kind::real, n}}};
  }
  static void size(const loop::Layout& layout, Message& message) {
    message.num_joints = layout.num_joints;
    message.position.resize(layout.num_joints);
  }
  static void write(const loop::PositionMeasurement& value, const loop::Layout& layout,
                    Message& message) {
    put(value.q, layout.num_joints, "q", message.position);
  }
  static Rejection check(const Message&) { return Rejection::none; }
  static void read(const Message& message, loop::PositionMeasurement& value) {
    get(message.position, value.q);
  }
};

template <>
struct Translation<loop::MotorPositionMeasurement> {
  using Message = tachless::motor_position_measurement_t;
  static MessageShape shape(const loop::Layout& layout) {
    require_joints(layout);
    const int n = layout.num_joints;
    return {Message::getHash(), {{Kind::count, n}, {Kind::real, n}}};
  }
  static void size(const loop::Layout& layout, Message& message) {
    message.num_joints = layout.num_joints;
    message.motor_position.resize(layout.num_joints);
  }
  static void write(const loop::MotorPositionMeasurement& value, const loop::Layout& layout,
                    Message& message) {
    put(value.theta, layout.num_joints, "theta", message.motor_position);
  }
  static Rejection check(const Message&) { return Rejection::none; }
  static void read(const Message& message, loop::MotorPositionMeasurement& value) {
    get(message.motor_position, value.theta);
  }
};

template <>
struct Translation<loop::LinkStateMeasurement> {
  using Message = tachless::link_state_measurement_t;
  static MessageShape shape(const loop::Layout& layout) {
    require_joints(layout);
    const int n = layout.num_joints;
    return {Message::getHash(), {{Kind::count, n}, {Kind::real, 3 * n}}};
  }
  static void size(const loop::Layout& layout, Message& message) {
    message.num_joints = layout.num_joints;
    message.position.resize(layout.num_joints);
    message.velocity.resize(layout.num_joints);
    message.motor_position.resize(layout.num_joints);
  }
  static void write(const loop::LinkStateMeasurement& value, const loop::Layout& layout,
                    Message& message) {
    put(value.q, layout.num_joints, "q", message.position);
    put(value.v, layout.num_joints, "v", message.velocity);
    put(value.theta, layout.num_joints, "theta", message.motor_position);
  }
  static Rejection check(const Message&) { return Rejection::none; }
  static void read(const Message& message, loop::LinkStateMeasurement& value) {
    get(message.position, value.q);
    get(message.velocity, value.v);
    get(message.motor_position, value.theta);
  }
};

template <>
struct Translation<loop::StateMeasurement> {
  using Message = tachless::state_measurement_t;
  static MessageShape shape(const loop::Layout& layout) {
    require_joints(layout);
    const int n = layout.num_joints;
    const int m = layout.num_motors;
    return {Message::getHash(), {{Kind::count, n}, {Kind::count, m}, {Kind::real, 2 * n + 2 * m}}};
  }
  static void size(const loop::Layout& layout, Message& message) {
    message.num_joints = layout.num_joints;
    message.num_motors = layout.num_motors;
    message.position.resize(layout.num_joints);
    message.velocity.resize(layout.num_joints);
    message.motor_position.resize(layout.num_motors);
    message.motor_velocity.resize(layout.num_motors);
  }
  static void write(const loop::StateMeasurement& value, const loop::Layout& layout,
                    Message& message) {
    put(value.q, layout.num_joints, "q", message.position);
    put(value.v, layout.num_joints, "v", message.velocity);
    put(value.theta, layout.num_motors, "theta", message.motor_position);
    put(value.thetadot, layout.num_motors, "thetadot", message.motor_velocity);
  }
  static Rejection check(const Message&) { return Rejection::none; }
  static void read(const Message& message, loop::StateMeasurement& value) {
    get(message.position, value.q);
    get(message.velocity, value.v);
    get(message.motor_position, value.theta);
    get(message.motor_velocity, value.thetadot);
  }
};

template <>
struct Translation<loop::ReferencePoint> {
  using Message = tachless::reference_t;
  static MessageShape shape(const loop::Layout& layout) {
    require_joints(layout);
    const int n = layout.num_joints;
    return {Message::getHash(), {{Kind::count, n}, {Kind::real, 5 * n}}};
  }
  static void size(const loop::Layout& layout, Message& message) {
    message.num_joints = layout.num_joints;
    message.position.resize(layout.num_joints);
    message.velocity.resize(layout.num_joints);
    message.acceleration.resize(layout.num_joints);
    message.jerk.resize(layout.num_joints);
    message.snap.resize(layout.num_joints);
  }
  static void write(const loop::ReferencePoint& value, const loop::Layout& layout,
                    Message& message) {
    put(value.q_ref, layout.num_joints, "q_ref", message.position);
    put(value.v_ref, layout.num_joints, "v_ref", message.velocity);
    put(value.a_ref, layout.num_joints, "a_ref", message.acceleration);
    put(value.jerk_ref, layout.num_joints, "jerk_ref", message.jerk);
    put(value.snap_ref, layout.num_joints, "snap_ref", message.snap);
  }
  static Rejection check(const Message&) { return Rejection::none; }
  static void read(const Message& message, loop::ReferencePoint& value) {
    get(message.position, value.q_ref);
    get(message.velocity, value.v_ref);
    get(message.acceleration, value.a_ref);
    get(message.jerk, value.jerk_ref);
    get(message.snap, value.snap_ref);
  }
};

template <>
struct Translation<loop::TorqueCommand> {
  using Message = tachless::torque_command_t;
  static MessageShape shape(const loop::Layout& layout) {
    require_joints(layout);
    const int n = layout.num_joints;
    return {Message::getHash(), {{Kind::count, n}, {Kind::real, n}}};
  }
  static void size(const loop::Layout& layout, Message& message) {
    message.num_joints = layout.num_joints;
    message.torque.resize(layout.num_joints);
  }
  static void write(const loop::TorqueCommand& value, const loop::Layout& layout,
                    Message& message) {
    put(value.tau, layout.num_joints, "tau", message.torque);
  }
  static Rejection check(const Message&) { return Rejection::none; }
  static void read(const Message& message, loop::TorqueCommand& value) {
    get(message.torque, value.tau);
  }
};

template <>
struct Translation<loop::LawSignals> {
  using Message = tachless::controller_state_t;
  static MessageShape shape(const loop::Layout& layout) {
    require_joints(layout);
    const int n = layout.num_joints;
    const int signals = layout.num_signals;
    return {Message::getHash(),
            {{Kind::count, signals}, {Kind::count, n}, {Kind::real, signals * n}}};
  }
  static void size(const loop::Layout& layout, Message& message) {
    message.num_signals = layout.num_signals;
    message.num_joints = layout.num_joints;
    message.value.assign(layout.num_signals, std::vector<double>(layout.num_joints));
  }
  static void write(const loop::LawSignals& value, const loop::Layout& layout, Message& message) {
    if (value.num != layout.num_signals) {
      throw std::logic_error("bus::Codec: controller state of " + std::to_string(value.num) +
                             " signals, the layout says " + std::to_string(layout.num_signals));
    }
    for (int i = 0; i < layout.num_signals; ++i) {
      put(value.value[i], layout.num_joints, "value", message.value[i]);
    }
  }
  static Rejection check(const Message&) { return Rejection::none; }
  static void read(const Message& message, loop::LawSignals& value) {
    value.num = message.num_signals;
    for (int i = 0; i < loop::max_signals; ++i) {
      if (i < message.num_signals) {
        get(message.value[i], value.value[i]);
      } else {
        value.value[i].resize(0);
      }
    }
  }
};

template <>
struct Translation<loop::Participant> {
  using Message = tachless::participant_t;
  static MessageShape shape(const loop::Layout&) {
    const Field text{Kind::text, loop::max_participant_text};
    return {Message::getHash(),
            {{Kind::int64, 2},
             {Kind::int32},
             {Kind::int8, 2},
             {Kind::real},
             text,
             text,
             text,
             text,
             text,
             text}};
  }
  static void size(const loop::Layout&, Message&) {}
  static void write(const loop::Participant& value, const loop::Layout&, Message& message) {
    require_text(value.host, loop::max_participant_text, "host");
    require_text(value.scenario, loop::max_participant_text, "scenario");
    require_text(value.measurement, loop::max_participant_text, "measurement");
    require_text(value.signals, loop::max_participant_text, "signals");
    require_text(value.fault, loop::max_participant_text, "fault");
    if (value.fault_code < 0 || value.fault_code > 255) {
      throw std::logic_error("bus::Codec: fault code " + std::to_string(value.fault_code) +
                             " is not an exit code, 0 to 255");
    }
    message.instance = value.instance;
    message.scenario_digest = value.scenario_digest;
    message.pid = value.pid;
    message.state = static_cast<std::int8_t>(value.state);
    message.fault_code = static_cast<std::int8_t>(static_cast<std::uint8_t>(value.fault_code));
    message.error_norm = value.error_norm;
    message.role = name(value.role);
    message.host = value.host;
    message.scenario = value.scenario;
    message.measurement = value.measurement;
    message.signals = value.signals;
    message.fault = value.fault;
    if (check(message) != Rejection::none) {
      throw std::logic_error("bus::Codec: a field of a participant is outside its range");
    }
  }
  static Rejection check(const Message& message) {
    const bool state_ok = message.state >= 0 &&
                          message.state <= static_cast<std::int8_t>(loop::ParticipantState::fault);
    return state_ok && message.error_norm >= 0 && role_named(message.role) ? Rejection::none
                                                                           : Rejection::bad_value;
  }
  static void read(const Message& message, loop::Participant& value) {
    value.instance = message.instance;
    value.scenario_digest = message.scenario_digest;
    value.pid = message.pid;
    value.state = static_cast<loop::ParticipantState>(message.state);
    value.fault_code = static_cast<std::uint8_t>(message.fault_code);
    value.error_norm = message.error_norm;
    value.role = *role_named(message.role);
    value.host = message.host;
    value.scenario = message.scenario;
    value.measurement = message.measurement;
    value.signals = message.signals;
    value.fault = message.fault;
  }
};

template <>
struct Translation<loop::RunInfo> {
  using Message = tachless::run_info_t;
  static MessageShape shape(const loop::Layout&) {
    const Field text{Kind::text, loop::max_run_info_size};
    return {Message::getHash(),
            {{Kind::int64}, {Kind::real}, text, text, text, text, text, text},
            loop::max_run_info_size};
  }
  static void size(const loop::Layout&, Message&) {}
  static void write(const loop::RunInfo& value, const loop::Layout&, Message& message) {
    require_text(value.version, loop::max_run_info_size, "version");
    require_text(value.robot, loop::max_run_info_size, "robot");
    require_text(value.measurement, loop::max_run_info_size, "measurement");
    require_text(value.signals, loop::max_run_info_size, "signals");
    require_text(value.scenario, loop::max_run_info_size, "scenario");
    require_text(value.robot_description, loop::max_run_info_size, "robot_description");
    message.num_ticks = value.num_ticks;
    message.period_s = value.period_s;
    message.version = value.version;
    message.robot = value.robot;
    message.measurement = value.measurement;
    message.signals = value.signals;
    message.scenario = value.scenario;
    message.robot_description = value.robot_description;
    if (check(message) != Rejection::none) {
      throw std::logic_error("bus::Codec: run info with no ticks or no period");
    }
  }
  static Rejection check(const Message& message) {
    return message.num_ticks > 0 && message.period_s > 0 ? Rejection::none : Rejection::bad_value;
  }
  static void read(const Message& message, loop::RunInfo& value) {
    value.num_ticks = message.num_ticks;
    value.period_s = message.period_s;
    value.version = message.version;
    value.robot = message.robot;
    value.measurement = message.measurement;
    value.signals = message.signals;
    value.scenario = message.scenario;
    value.robot_description = message.robot_description;
  }
};

template <>
struct Translation<loop::LogAck> {
  using Message = tachless::log_ack_t;
  static MessageShape shape(const loop::Layout&) { return {Message::getHash(), {{Kind::int64}}}; }
  static void size(const loop::Layout&, Message&) {}
  static void write(const loop::LogAck& value, const loop::Layout&, Message& message) {
    message.missing = static_cast<std::int64_t>(value.missing);
  }
  static Rejection check(const Message&) { return Rejection::none; }
  static void read(const Message& message, loop::LogAck& value) {
    value.missing = static_cast<std::uint64_t>(message.missing);
  }
};

template class Codec<loop::Tick>;
template class Codec<loop::PositionMeasurement>;
template class Codec<loop::MotorPositionMeasurement>;
template class Codec<loop::LinkStateMeasurement>;
template class Codec<loop::StateMeasurement>;
template class Codec<loop::ReferencePoint>;
template class Codec<loop::TorqueCommand>;
template class Codec<loop::LawSignals>;
template class Codec<loop::Participant>;
template class Codec<loop::RunInfo>;
template class Codec<loop::LogAck>;

}  // namespace tachless::bus

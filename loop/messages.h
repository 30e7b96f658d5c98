#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>

#include "loop/field.h"
#include "loop/signals.h"

/// What travels between the four processes: values, and the table of fields of each message. Knows
/// no bytes and no transport (bus/), and no ground truth (loop/truth).
namespace tachless::loop {

/// What every message starts with.
struct Stamp {
  std::int64_t utime = 0;  ///< [us] simulation time of the tick (realtime: since the start)
  std::int64_t run = 0;    ///< id of the run
  std::int64_t tick = 0;
};

/// Sizes that fix the length of every message of a run.
struct Layout {
  int num_joints = 0;
  int num_motors = 0;   ///< num_joints on a flexible-joint robot, else 0
  int num_signals = 0;  ///< that the law declares; only controller_state_t depends on it

  bool operator==(const Layout&) const = default;
};

/// The layout of a run's messages. `num_signals` matters to controller_state_t alone.
constexpr Layout layout(int num_joints, bool flexible, int num_signals = 0) {
  return {num_joints, flexible ? num_joints : 0, num_signals};
}

/// plant -> reference
struct Tick {
  bool last = false;
};

enum class Role : std::uint8_t { plant, reference, controller, logger };
inline constexpr int num_roles = 4;
std::string_view name(Role role);

enum class ParticipantState : std::int8_t { waiting, ready, running, finished, fault };
std::string_view name(ParticipantState state);

/// A number for each role, in the order of Role; 0: none.
using PerRole = std::array<std::int64_t, num_roles>;

/// What a controller announces of its law.
struct LawInfo {
  std::string name;         ///< what it calls itself
  std::string measurement;  ///< channel suffix of what it needs
  std::string signals;      ///< rows of LawSignals, as `text_of` gives them
};

struct Participant {
  std::int64_t instance = 0;
  std::int64_t scenario_digest = 0;
  std::int32_t pid = 0;
  ParticipantState state = ParticipantState::waiting;
  int fault_code = 0;     ///< exit code that goes with the fault
  double error_norm = 0;  ///< controller only: newest position error [rad]
  Role role = Role::plant;
  std::string host;
  std::string scenario;     ///< its name, for messages to people
  std::string law;          ///< controller only: what its law calls itself
  std::string measurement;  ///< controller only: channel suffix of what it needs
  std::string signals;      ///< controller only: what its law declares, as `text_of` gives it
  std::string fault;
  std::int64_t counter = 0;  ///< rises with every announcement of an instance
  /// Of one process of each role that the sender has heard: its instance, and the newest of its
  /// counters. What answers one of the receiver's own is no recording.
  PerRole heard_instance{}, heard_counter{};
  /// The instances that take part in the run: chosen by the plant, confirmed by the others.
  PerRole roster{};
  std::int64_t truth_digest = 0;  ///< lockstep plant that has finished: of all TRUTH, in order
};

struct RunInfo {
  std::int64_t num_ticks = 0;
  double period_s = 0;
  std::string version;
  std::string robot;
  std::string law;
  std::string measurement;
  std::string signals;  ///< rows of LawSignals, as `text_of` gives them
  std::string scenario;
  std::string robot_description;
};

/// logger -> plant; `Stamp::tick` is the last tick recorded without a gap.
struct LogAck {
  std::uint64_t missing = 0;  ///< bit i: tick + 1 + i was seen to begin but is incomplete
};

/// Most characters in each text of a participant_t.
inline constexpr int max_participant_text = 1024;
/// Most bytes of a run_info_t, so that it fits one datagram.
inline constexpr int max_run_info_size = 65'000;

template <>
struct MessageOf<Tick> {
  static constexpr std::string_view type = "tachless.tick_t";
  static constexpr std::string_view suffix = "TICK";
  static constexpr bool once_per_tick = true;
  static constexpr auto fields = std::tuple{number("last", "", Kind::flag, &Tick::last)};
};

template <>
struct MessageOf<PositionMeasurement> {
  using Value = PositionMeasurement;
  static constexpr std::string_view type = "tachless.position_measurement_t";
  static constexpr std::string_view suffix = "POSITION";
  static constexpr bool once_per_tick = true;
  static constexpr auto fields =
      std::tuple{per_joint("position", "q", "rad", &Value::q, "link position")};
};

template <>
struct MessageOf<MotorPositionMeasurement> {
  using Value = MotorPositionMeasurement;
  static constexpr std::string_view type = "tachless.motor_position_measurement_t";
  static constexpr std::string_view suffix = "MOTOR_POSITION";
  static constexpr bool once_per_tick = true;
  static constexpr auto fields =
      std::tuple{per_joint("motor_position", "theta", "rad", &Value::theta, "motor position")};
};

template <>
struct MessageOf<LinkStateMeasurement> {
  using Value = LinkStateMeasurement;
  static constexpr std::string_view type = "tachless.link_state_measurement_t";
  static constexpr std::string_view suffix = "LINK_STATE";
  static constexpr bool once_per_tick = true;
  static constexpr auto fields =
      std::tuple{per_joint("position", "q", "rad", &Value::q, "link position"),
                 per_joint("velocity", "v", "rad/s", &Value::v, "link velocity"),
                 per_joint("motor_position", "theta", "rad", &Value::theta, "motor position")};
};

template <>
struct MessageOf<StateMeasurement> {
  using Value = StateMeasurement;
  static constexpr std::string_view type = "tachless.state_measurement_t";
  static constexpr std::string_view suffix = "STATE";
  static constexpr bool once_per_tick = true;
  static constexpr auto fields = std::tuple{
      per_joint("position", "q", "rad", &Value::q, "link position"),
      per_joint("velocity", "v", "rad/s", &Value::v, "link velocity"),
      per_motor("motor_position", "theta", "rad", &Value::theta, "motor position"),
      per_motor("motor_velocity", "thetadot", "rad/s", &Value::thetadot, "motor velocity")};
};

template <>
struct MessageOf<ReferencePoint> {
  using Value = ReferencePoint;
  static constexpr std::string_view type = "tachless.reference_t";
  static constexpr std::string_view suffix = "REFERENCE";
  static constexpr bool once_per_tick = true;
  static constexpr auto fields = std::tuple{
      per_joint("position", "q_ref", "rad", &Value::q_ref, "reference position"),
      per_joint("velocity", "v_ref", "rad/s", &Value::v_ref, "reference velocity"),
      per_joint("acceleration", "a_ref", "rad/s^2", &Value::a_ref, "reference acceleration"),
      per_joint("jerk", "jerk_ref", "rad/s^3", &Value::jerk_ref, "reference jerk"),
      per_joint("snap", "snap_ref", "rad/s^4", &Value::snap_ref, "reference snap")};
};

template <>
struct MessageOf<TorqueCommand> {
  static constexpr std::string_view type = "tachless.torque_command_t";
  static constexpr std::string_view suffix = "COMMAND";
  static constexpr bool once_per_tick = true;
  static constexpr auto fields =
      std::tuple{per_joint("torque", "tau", "N m", &TorqueCommand::tau,
                           "motor torque commanded from this tick's measurement")};
};

/// Names and units of the rows are the law's: `Participant::signals`, `RunInfo::signals`.
template <>
struct MessageOf<LawSignals> {
  static constexpr std::string_view type = "tachless.controller_state_t";
  static constexpr std::string_view suffix = "CONTROLLER_STATE";
  static constexpr bool once_per_tick = true;
  static constexpr auto fields =
      std::tuple{Field<LawSignals, std::array<robot::Vector, max_signals>>{
          "value", "value", "", Kind::real, Count::signals, &LawSignals::value}};
};

template <>
struct MessageOf<Participant> {
  using Value = Participant;
  static constexpr std::string_view type = "tachless.participant_t";
  static constexpr std::string_view suffix = "PARTICIPANT";
  static constexpr bool once_per_tick = false;
  static constexpr auto fields =
      std::tuple{text("role", max_participant_text, &Value::role),
                 number("state", "", Kind::int8, &Value::state, 0,
                        static_cast<double>(ParticipantState::fault)),
                 number("error_norm", "rad", Kind::real, &Value::error_norm, 0),
                 text("scenario", max_participant_text, &Value::scenario),
                 text("host", max_participant_text, &Value::host),
                 number("pid", "", Kind::int32, &Value::pid),
                 text("law", max_participant_text, &Value::law),
                 text("measurement", max_participant_text, &Value::measurement),
                 text("signals", max_participant_text, &Value::signals),
                 number("fault_code", "", Kind::uint8, &Value::fault_code, 0, 255),
                 text("fault", max_participant_text, &Value::fault),
                 number("instance", "", Kind::int64, &Value::instance),
                 number("scenario_digest", "", Kind::int64, &Value::scenario_digest),
                 number("counter", "", Kind::int64, &Value::counter),
                 per_role("heard_instance", &Value::heard_instance),
                 per_role("heard_counter", &Value::heard_counter),
                 per_role("roster", &Value::roster),
                 number("truth_digest", "", Kind::int64, &Value::truth_digest)};
};

template <>
struct MessageOf<RunInfo> {
  using Value = RunInfo;
  static constexpr std::string_view type = "tachless.run_info_t";
  static constexpr std::string_view suffix = "RUN_INFO";
  static constexpr bool once_per_tick = false;
  static constexpr std::size_t max_size = max_run_info_size;
  static constexpr auto fields =
      std::tuple{number("num_ticks", "", Kind::int64, &Value::num_ticks, 1),
                 number("period_s", "s", Kind::real, &Value::period_s,
                        std::numeric_limits<double>::denorm_min()),
                 text("version", max_size, &Value::version),
                 text("robot", max_size, &Value::robot),
                 text("law", max_size, &Value::law),
                 text("measurement", max_size, &Value::measurement),
                 text("signals", max_size, &Value::signals),
                 text("scenario", max_size, &Value::scenario),
                 text("robot_description", max_size, &Value::robot_description)};
};

template <>
struct MessageOf<LogAck> {
  static constexpr std::string_view type = "tachless.log_ack_t";
  static constexpr std::string_view suffix = "LOG_ACK";
  static constexpr bool once_per_tick = false;
  static constexpr auto fields = std::tuple{number("missing", "", Kind::int64, &LogAck::missing)};
};

/// Types of messages; `loop/truth` adds one.
template <class... Value>
struct TypeList {};
using Messages = TypeList<Tick, PositionMeasurement, MotorPositionMeasurement, LinkStateMeasurement,
                          StateMeasurement, ReferencePoint, TorqueCommand, LawSignals, Participant,
                          RunInfo, LogAck>;

/// Calls `f(std::type_identity<Value>())` for each type of the list, in order.
template <class... Value, class F>
constexpr void for_each_type(TypeList<Value...> /*list*/, F&& f) {
  (f(std::type_identity<Value>()), ...);
}

}  // namespace tachless::loop

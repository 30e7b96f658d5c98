#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "loop/signals.h"

/// What travels between the four processes besides the signals: values without bytes.
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
  std::string measurement;  ///< controller only: channel suffix of what it needs
  std::string signals;      ///< controller only: what its law declares, as `text_of` gives it
  std::string fault;
};

struct RunInfo {
  std::int64_t num_ticks = 0;
  double period_s = 0;
  std::string version;
  std::string robot;
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

/// Channel suffix of each value type: the node takes its channel from the type, never from an
/// option. `loop/truth` adds its own.
template <class Value>
struct ChannelOf;
template <>
struct ChannelOf<Tick> {
  static constexpr std::string_view suffix = "TICK";
};
template <>
struct ChannelOf<PositionMeasurement> {
  static constexpr std::string_view suffix = "POSITION";
};
template <>
struct ChannelOf<MotorPositionMeasurement> {
  static constexpr std::string_view suffix = "MOTOR_POSITION";
};
template <>
struct ChannelOf<LinkStateMeasurement> {
  static constexpr std::string_view suffix = "LINK_STATE";
};
template <>
struct ChannelOf<StateMeasurement> {
  static constexpr std::string_view suffix = "STATE";
};
template <>
struct ChannelOf<ReferencePoint> {
  static constexpr std::string_view suffix = "REFERENCE";
};
template <>
struct ChannelOf<TorqueCommand> {
  static constexpr std::string_view suffix = "COMMAND";
};
template <>
struct ChannelOf<LawSignals> {
  static constexpr std::string_view suffix = "CONTROLLER_STATE";
};
template <>
struct ChannelOf<Participant> {
  static constexpr std::string_view suffix = "PARTICIPANT";
};
template <>
struct ChannelOf<RunInfo> {
  static constexpr std::string_view suffix = "RUN_INFO";
};
template <>
struct ChannelOf<LogAck> {
  static constexpr std::string_view suffix = "LOG_ACK";
};

/// Full channel name, e.g. "ARM_POSITION". `robot` is already upper case.
template <class Value>
std::string channel(std::string_view robot) {
  return std::string(robot) + "_" + std::string(ChannelOf<Value>::suffix);
}

}  // namespace tachless::loop

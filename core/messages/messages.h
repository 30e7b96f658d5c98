#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>

#include "messages/field.h"
#include "messages/signals.h"

/// The messages of the four processes, besides the values of core/messages/signals.h, and the list
/// of all messages. This header knows no bytes, no transport and no ground truth (messages/truth).
namespace tachless::messages {

/// The common header of all messages.
struct Stamp {
  /// Greatest `utime` of a message [us], some 285 years. In nanoseconds it still fits an int64.
  static constexpr std::int64_t max_utime = 9'000'000'000'000'000;

  std::int64_t utime = 0;  ///< [us] simulation time of the tick (realtime: since the start)
  std::int64_t run = 0;    ///< id of the run
  std::int64_t tick = 0;
};

/// Sizes that fix the length of every message of a run.
struct Layout {
  int num_joints = 0;
  int num_motors = 0;   ///< num_joints on a flexible-joint robot, else 0
  int num_signals = 0;  ///< number that the law declares; only controller_state_t depends on it

  bool operator==(const Layout&) const = default;
};

/// Returns the layout of a run's messages. Only controller_state_t depends on `num_signals`.
constexpr Layout layout(int num_joints, bool flexible, int num_signals = 0) {
  return {num_joints, flexible ? num_joints : 0, num_signals};
}

enum class Role : std::uint8_t { plant, reference, controller, logger };
inline constexpr int num_roles = 4;
constexpr std::string_view name(Role role) {
  constexpr std::array<std::string_view, num_roles> names = {"plant", "reference", "controller",
                                                             "logger"};
  return names.at(static_cast<std::size_t>(role));
}

enum class ParticipantState : std::int8_t { waiting, ready, running, finished, fault };
constexpr std::string_view name(ParticipantState state) {
  constexpr std::array<std::string_view, 5> names = {"waiting", "ready", "running", "finished",
                                                     "fault"};
  return names.at(static_cast<std::size_t>(state));
}

/// A number for each role, in the order of Role; 0 means none.
using PerRole = std::array<std::int64_t, num_roles>;

/// A controller's announcement of its law.
struct LawInfo {
  std::string law;          ///< name that the law has chosen
  std::string measurement;  ///< channel suffix of the law's measurement
  std::string signals;      ///< rows of LawSignals, in the form of `text_of`
};

/// Most characters in each text of a participant_t.
inline constexpr int max_participant_text = 1024;
/// Most bytes of a run_info_t, so that it fits one datagram.
inline constexpr int max_run_info_size = 65'000;

/// Message from the plant to the reference.
struct Tick {
  bool last = false;  ///< the tick is the last one of the run

  static constexpr std::string_view type = "tachless.tick_t", suffix = "TICK";
  static constexpr auto fields = std::tuple{number("last", "", Kind::flag, &Tick::last)};
};

/// Announcement of a process. Only a controller fills its LawInfo.
struct Participant : LawInfo {
  std::int64_t instance = 0;
  std::int64_t scenario_digest = 0;
  std::int32_t pid = 0;
  ParticipantState state = ParticipantState::waiting;
  int fault_code = 0;     ///< exit code that goes with the fault
  double error_norm = 0;  ///< controller only: newest position error [rad]
  Role role = Role::plant;
  std::string host;
  std::string scenario;  ///< name of the scenario, for messages to people
  std::string fault;
  std::int64_t counter = 0;  ///< increases with every announcement of an instance
  /// For one process of each role that the sender has heard: the instance and its newest counter. A
  /// message that contains one of the receiver's own counters is an answer and not a recording.
  PerRole heard_instance{}, heard_counter{};
  /// Instances that take part in the run. The plant chooses them, and the others confirm them.
  PerRole roster{};
  /// Lockstep plant that has finished: digest of all TRUTH, in order; else 0.
  std::int64_t truth_digest = 0;

  using Value = Participant;
  static constexpr std::size_t longest = max_participant_text;
  static constexpr std::string_view type = "tachless.participant_t", suffix = "PARTICIPANT";
  static constexpr auto fields =
      std::tuple{text("role", longest, &Value::role),
                 number("state", "", Kind::int8, &Value::state, 0,
                        static_cast<double>(ParticipantState::fault)),
                 number("error_norm", "rad", Kind::real, &Value::error_norm, 0),
                 text("scenario", longest, &Value::scenario),
                 text("host", longest, &Value::host),
                 number("pid", "", Kind::int32, &Value::pid),
                 text<Value, std::string>("law", longest, &Value::law),
                 text<Value, std::string>("measurement", longest, &Value::measurement),
                 text<Value, std::string>("signals", longest, &Value::signals),
                 number("fault_code", "", Kind::uint8, &Value::fault_code, 0, 255),
                 text("fault", longest, &Value::fault),
                 number("instance", "", Kind::int64, &Value::instance),
                 number("scenario_digest", "", Kind::int64, &Value::scenario_digest),
                 number("counter", "", Kind::int64, &Value::counter),
                 per_role("heard_instance", &Value::heard_instance),
                 per_role("heard_counter", &Value::heard_counter),
                 per_role("roster", &Value::roster),
                 number("truth_digest", "", Kind::int64, &Value::truth_digest)};
};

/// Facts about a run, for its log.
struct RunInfo : LawInfo {
  std::int64_t num_ticks = 0;
  double period_s = 0;
  std::string version;
  std::string robot;
  std::string scenario;
  std::string robot_description;

  using Value = RunInfo;
  static constexpr std::size_t max_size = max_run_info_size;
  static constexpr std::string_view type = "tachless.run_info_t", suffix = "RUN_INFO";
  static constexpr auto fields =
      std::tuple{number("num_ticks", "", Kind::int64, &Value::num_ticks, 1),
                 number("period_s", "s", Kind::real, &Value::period_s,
                        std::numeric_limits<double>::denorm_min()),
                 text("version", max_size, &Value::version),
                 text("robot", max_size, &Value::robot),
                 text<Value, std::string>("law", max_size, &Value::law),
                 text<Value, std::string>("measurement", max_size, &Value::measurement),
                 text<Value, std::string>("signals", max_size, &Value::signals),
                 file("scenario", max_size, &Value::scenario),
                 file("robot_description", max_size, &Value::robot_description)};
};

/// Message from the logger to the plant. `Stamp::tick` is the last tick recorded without a gap.
struct LogAck {
  std::uint64_t missing = 0;  ///< bit i: tick + 1 + i has begun but is incomplete

  static constexpr std::string_view type = "tachless.log_ack_t", suffix = "LOG_ACK";
  static constexpr auto fields = std::tuple{number("missing", "", Kind::int64, &LogAck::missing)};
};

/// Message from `tachless gains` to the reference. `Stamp::tick` is the newest tick that the sender
/// has seen.
struct GainChange {
  std::string gains;                 ///< gains in the form of scenario::gains_text
  std::string replaces;              ///< gains in force that the sender has seen; empty: none yet
  std::int64_t scenario_digest = 0;  ///< digest of the scenario that the sender has analysed
  std::int64_t number = 0;           ///< random; `GainAck` repeats it

  static constexpr std::string_view type = "tachless.gains_t", suffix = "GAINS";
  static constexpr auto fields =
      std::tuple{text("gains", max_gains_text, &GainChange::gains),
                 text("replaces", max_gains_text, &GainChange::replaces),
                 messages::number("scenario_digest", "", Kind::int64, &GainChange::scenario_digest),
                 messages::number("number", "", Kind::int64, &GainChange::number)};
};

/// Message from the reference to `tachless gains`: a change is accepted. `Stamp::tick` is the first
/// tick with it.
struct GainAck {
  std::int64_t number = 0;  ///< number of the accepted `GainChange`

  static constexpr std::string_view type = "tachless.gains_ack_t", suffix = "GAINS_ACK";
  static constexpr auto fields =
      std::tuple{messages::number("number", "", Kind::int64, &GainAck::number)};
};

/// Types of messages; messages/truth adds one.
template <class... Value>
struct TypeList {};
using Messages =
    TypeList<Tick, PositionMeasurement, MotorPositionMeasurement, BothPositionsMeasurement,
             LinkStateMeasurement, StateMeasurement, ReferencePoint, TorqueCommand, LawSignals,
             Participant, RunInfo, LogAck, GainChange, GainAck>;

/// Calls `f(std::type_identity<Value>())` for each type of the list, in order.
template <class... Value, class F>
constexpr void for_each_type(TypeList<Value...> /*list*/, F&& f) {
  (f(std::type_identity<Value>()), ...);
}

}  // namespace tachless::messages

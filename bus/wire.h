#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "robot/signals.h"

/// Domain value <-> message bytes, with every check done before anything is decoded. Neither
/// subscribes nor computes.
namespace bus {

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
  int num_filters = 0;  ///< of the law; only controller_state_t depends on it
};

/// Why a datagram was not accepted. Nothing is decoded from one that is not `none`.
enum class Rejection {
  none,
  wrong_size,   ///< not exactly the length of the expected type with the run's joint count
  wrong_type,   ///< the LCM fingerprint is another type's
  wrong_count,  ///< an array count inside contradicts the length
  non_finite,   ///< a double is NaN or infinite
  bad_text,     ///< a string's length or terminator is wrong
  bad_value,    ///< a field is outside its documented range
};
std::string_view name(Rejection rejection);

/// Fingerprint and stamp, with which every message begins [bytes].
inline constexpr std::size_t stamp_end = 8 + 3 * sizeof(std::int64_t);

/// The stamp of a message that a codec found to have the right shape (`none` or `non_finite`).
/// @throw std::logic_error when the bytes are too few to hold one.
Stamp stamp_of(std::span<const std::byte> payload);

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
  std::string fault;
};

struct RunInfo {
  std::int64_t num_ticks = 0;
  double period_s = 0;
  std::string version;
  std::string robot;
  std::string measurement;
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

/// True when no number in the value is NaN or infinite. A node asks before it encodes what it
/// has computed, and stops with a fault of its own if the answer is no.
bool all_finite(const Tick& value);
bool all_finite(const robot::PositionMeasurement& value);
bool all_finite(const robot::MotorPositionMeasurement& value);
bool all_finite(const robot::LinkStateMeasurement& value);
bool all_finite(const robot::StateMeasurement& value);
bool all_finite(const robot::ReferencePoint& value);
bool all_finite(const robot::TorqueCommand& value);
bool all_finite(const robot::ControllerState& value);
bool all_finite(const Participant& value);
bool all_finite(const RunInfo& value);
bool all_finite(const LogAck& value);

/// Channel suffix of each value type: the node takes its channel from the type, never from an
/// option. `bus::truth` adds its own in its own target.
template <class Value>
struct ChannelOf;
template <>
struct ChannelOf<Tick> {
  static constexpr std::string_view suffix = "TICK";
};
template <>
struct ChannelOf<robot::PositionMeasurement> {
  static constexpr std::string_view suffix = "POSITION";
};
template <>
struct ChannelOf<robot::MotorPositionMeasurement> {
  static constexpr std::string_view suffix = "MOTOR_POSITION";
};
template <>
struct ChannelOf<robot::LinkStateMeasurement> {
  static constexpr std::string_view suffix = "LINK_STATE";
};
template <>
struct ChannelOf<robot::StateMeasurement> {
  static constexpr std::string_view suffix = "STATE";
};
template <>
struct ChannelOf<robot::ReferencePoint> {
  static constexpr std::string_view suffix = "REFERENCE";
};
template <>
struct ChannelOf<robot::TorqueCommand> {
  static constexpr std::string_view suffix = "COMMAND";
};
template <>
struct ChannelOf<robot::ControllerState> {
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

/// Encoder and decoder of one message type for one layout. Owns its scratch memory, so that
/// fixed-size messages cost no allocation after construction. Explicitly instantiated for the
/// types above (and in bus/truth for PlantTruth).
/// One codec serves one thread at a time.
template <class Value>
class Codec {
 public:
  /// @throw std::logic_error if the message has joint arrays and the layout does not hold 1 to
  /// robot::max_joints joints, as many motors or none, and 0 to robot::max_filters filters
  explicit Codec(const Layout& layout);
  ~Codec();
  Codec(Codec&&) noexcept;
  Codec& operator=(Codec&&) noexcept;

  /// The message's bytes; valid until the next call. Precondition: sizes agree with the layout,
  /// `all_finite(value)`, single fields in their range, texts short enough and without NUL.
  /// @throw std::domain_error if a number is NaN or infinite
  /// @throw std::length_error if a text, or the whole message, is too long for its message type
  /// @throw std::logic_error if anything else of the precondition is broken (base of both)
  std::span<const std::byte> encode(const Stamp& stamp, const Value& value);

  /// Bytes of the longest message there is; of every one, if the type holds no text.
  [[nodiscard]] std::size_t longest() const;

  /// Checks first (size, fingerprint, counts, finiteness, texts), then decodes. On rejection
  /// `stamp` and `value` are untouched. Does not look at run or tick: that is the node's.
  Rejection decode(std::span<const std::byte> payload, Stamp& stamp, Value& value) const;

 private:
  struct Scratch;
  std::unique_ptr<Scratch> scratch_;
};

}  // namespace bus

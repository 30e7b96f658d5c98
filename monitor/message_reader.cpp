#include "monitor/message_reader.h"

#include <optional>
#include <stdexcept>
#include <type_traits>

#include "bus/authenticated.h"
#include "bus/truth/truth_wire.h"
#include "logger/message_types.h"

namespace tachless::monitor {
namespace {

using Fields = std::vector<MessageField>;

constexpr std::size_t counts_offset = 32;  // after fingerprint, utime, run and tick

std::vector<double> list(const robot::Vector& x) { return {x.begin(), x.end()}; }

Fields describe(const loop::Tick& m) { return {{"last", "", m.last}}; }
Fields describe(const loop::PositionMeasurement& m) { return {{"position", "rad", list(m.q)}}; }
Fields describe(const loop::MotorPositionMeasurement& m) {
  return {{"motor_position", "rad", list(m.theta)}};
}
Fields describe(const loop::LinkStateMeasurement& m) {
  return {{"position", "rad", list(m.q)},
          {"velocity", "rad/s", list(m.v)},
          {"motor_position", "rad", list(m.theta)}};
}
Fields describe(const loop::StateMeasurement& m) {
  return {{"position", "rad", list(m.q)},
          {"velocity", "rad/s", list(m.v)},
          {"motor_position", "rad", list(m.theta)},
          {"motor_velocity", "rad/s", list(m.thetadot)}};
}
Fields describe(const loop::ReferencePoint& m) {
  return {{"position", "rad", list(m.q_ref)},
          {"velocity", "rad/s", list(m.v_ref)},
          {"acceleration", "rad/s^2", list(m.a_ref)},
          {"jerk", "rad/s^3", list(m.jerk_ref)},
          {"snap", "rad/s^4", list(m.snap_ref)}};
}
Fields describe(const loop::TorqueCommand& m) { return {{"torque", "N m", list(m.tau)}}; }
Fields describe(const loop::LawSignals& m) {
  static constexpr std::array<std::string_view, loop::max_signals> names = {
      "value[0]", "value[1]", "value[2]", "value[3]",
      "value[4]", "value[5]", "value[6]", "value[7]"};
  Fields fields;
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.num); ++i) {
    fields.push_back({names[i], "", list(m.value[i])});
  }
  return fields;
}
std::string_view name(loop::ParticipantState state) {
  switch (state) {
    case loop::ParticipantState::waiting:
      return "waiting";
    case loop::ParticipantState::ready:
      return "ready";
    case loop::ParticipantState::running:
      return "running";
    case loop::ParticipantState::finished:
      return "finished";
    case loop::ParticipantState::fault:
      return "fault";
  }
  throw std::logic_error("a participant's state was not checked");
}
Fields describe(const loop::Participant& m) {
  return {{"role", "", std::string(loop::name(m.role))},
          {"state", "", std::string(name(m.state))},
          {"error_norm", "rad", m.error_norm},
          {"scenario", "", m.scenario},
          {"host", "", m.host},
          {"pid", "", std::int64_t{m.pid}},
          {"measurement", "", m.measurement},
          {"signals", "", m.signals},
          {"fault_code", "", std::int64_t{m.fault_code}},
          {"fault", "", m.fault},
          {"instance", "", m.instance},
          {"scenario_digest", "", m.scenario_digest}};
}
Fields describe(const loop::RunInfo& m) {
  return {{"num_ticks", "", m.num_ticks},     {"period_s", "s", m.period_s},
          {"version", "", m.version},         {"robot", "", m.robot},
          {"measurement", "", m.measurement}, {"signals", "", m.signals},
          {"scenario", "", m.scenario},       {"robot_description", "", m.robot_description}};
}
Fields describe(const loop::LogAck& m) {
  return {{"missing", "", static_cast<std::int64_t>(m.missing)}};
}
Fields describe(const loop::truth::PlantTruth& m) {
  std::vector<double> saturated;
  for (Eigen::Index i = 0; i < m.tau.size(); ++i) {
    saturated.push_back(m.saturated[static_cast<std::size_t>(i)] ? 1 : 0);
  }
  return {{"position", "rad", list(m.q)},
          {"velocity", "rad/s", list(m.v)},
          {"motor_position", "rad", list(m.theta)},
          {"motor_velocity", "rad/s", list(m.thetadot)},
          {"torque", "N m", list(m.tau)},
          {"saturated", "", std::move(saturated)},
          {"fault", "", static_cast<std::int64_t>(m.fault)}};
}

/// The counts that a message of the type begins with.
enum class Counts { none, joints, joints_motors, signals_joints };

template <class Value>
constexpr Counts counts_of() {
  using std::is_same_v;
  if constexpr (is_same_v<Value, loop::Tick> || is_same_v<Value, loop::Participant> ||
                is_same_v<Value, loop::RunInfo> || is_same_v<Value, loop::LogAck>) {
    return Counts::none;
  } else if constexpr (is_same_v<Value, loop::StateMeasurement> ||
                       is_same_v<Value, loop::truth::PlantTruth>) {
    return Counts::joints_motors;
  } else if constexpr (is_same_v<Value, loop::LawSignals>) {
    return Counts::signals_joints;
  } else {
    return Counts::joints;
  }
}

/// The int32 at that place if it is there and within bounds.
std::optional<int> count_at(std::span<const std::byte> message, std::size_t offset, int lowest,
                            int highest) {
  if (message.size() < offset + 4) return std::nullopt;
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    value = value << 8 | std::to_integer<std::uint32_t>(message[offset + i]);
  }
  const auto count = static_cast<std::int32_t>(value);
  if (count < lowest || count > highest) return std::nullopt;
  return count;
}

/// The layout that the message announces, if a message can have it.
std::optional<loop::Layout> announced_layout(Counts counts, std::span<const std::byte> message) {
  constexpr std::size_t second = counts_offset + 4;
  std::optional<int> joints = 1;
  std::optional<int> motors = 0;
  std::optional<int> signals = 0;
  switch (counts) {
    case Counts::none:
      break;
    case Counts::joints:
      joints = count_at(message, counts_offset, 1, robot::max_joints);
      break;
    case Counts::joints_motors:
      joints = count_at(message, counts_offset, 1, robot::max_joints);
      motors = count_at(message, second, 0, robot::max_joints);
      if (motors && *motors != 0 && motors != joints) return std::nullopt;
      break;
    case Counts::signals_joints:
      signals = count_at(message, counts_offset, 0, loop::max_signals);
      joints = count_at(message, second, 1, robot::max_joints);
      break;
  }
  if (!joints || !motors || !signals) return std::nullopt;
  return loop::Layout{*joints, *motors, *signals};
}

bool operator==(const loop::Layout& a, const loop::Layout& b) {
  return a.num_joints == b.num_joints && a.num_motors == b.num_motors &&
         a.num_signals == b.num_signals;
}

}  // namespace

class MessageReader::OfType {
 public:
  OfType(std::string_view its_type, bool every_tick) : type(its_type), once_per_tick(every_tick) {}
  OfType(const OfType&) = delete;
  OfType& operator=(const OfType&) = delete;
  virtual ~OfType() = default;

  virtual bus::Rejection decode(std::span<const std::byte> message, loop::Stamp& stamp) = 0;
  /// Of the message decoded last.
  [[nodiscard]] virtual Fields fields() const = 0;

  const std::string_view type;
  const bool once_per_tick;
};

template <class Value>
class MessageReader::Reader final : public OfType {
 public:
  using OfType::OfType;

  bus::Rejection decode(std::span<const std::byte> message, loop::Stamp& stamp) override {
    const auto layout = announced_layout(counts_of<Value>(), message);
    if (!layout) return bus::Rejection::wrong_count;
    if (!codec_ || !(*layout == layout_)) {
      codec_.emplace(*layout);
      layout_ = *layout;
    }
    return codec_->decode(message, stamp, value_);
  }

  [[nodiscard]] Fields fields() const override { return describe(value_); }

 private:
  loop::Layout layout_;
  std::optional<bus::Codec<Value>> codec_;
  Value value_;
};

MessageReader::MessageReader() {
  const auto add = [&]<class Value>(std::type_identity<Value> /*type*/, std::string_view type,
                                    bool once_per_tick) {
    readers_.push_back(std::make_unique<Reader<Value>>(type, once_per_tick));
  };
  using std::type_identity;
  add(type_identity<loop::Tick>(), "tachless.tick_t", true);
  add(type_identity<loop::PositionMeasurement>(), "tachless.position_measurement_t", true);
  add(type_identity<loop::MotorPositionMeasurement>(), "tachless.motor_position_measurement_t",
      true);
  add(type_identity<loop::LinkStateMeasurement>(), "tachless.link_state_measurement_t", true);
  add(type_identity<loop::StateMeasurement>(), "tachless.state_measurement_t", true);
  add(type_identity<loop::ReferencePoint>(), "tachless.reference_t", true);
  add(type_identity<loop::TorqueCommand>(), "tachless.torque_command_t", true);
  add(type_identity<loop::LawSignals>(), "tachless.controller_state_t", true);
  add(type_identity<loop::Participant>(), "tachless.participant_t", false);
  add(type_identity<loop::RunInfo>(), "tachless.run_info_t", false);
  add(type_identity<loop::LogAck>(), "tachless.log_ack_t", false);
  add(type_identity<loop::truth::PlantTruth>(), "tachless_truth.plant_truth_t", true);
}

MessageReader::~MessageReader() = default;

MessageReader::OfType* MessageReader::reader_of(std::string_view type) const {
  for (const auto& reader : readers_) {
    if (reader->type == type) return reader.get();
  }
  return nullptr;
}

MessageReader::Glance MessageReader::glance(std::span<const std::byte> message) {
  Glance glance;
  glance.type = logger::type_name(message);
  if (glance.type.empty()) return glance;
  OfType* reader = reader_of(glance.type);
  if (reader == nullptr) throw std::logic_error("no reader for " + std::string(glance.type));
  glance.once_per_tick = reader->once_per_tick;
  glance.rejection = reader->decode(message, glance.stamp);
  if (glance.rejection == bus::Rejection::wrong_size && message.size() > bus::tag_size) {
    const auto untagged = message.first(message.size() - bus::tag_size);
    glance.tagged = reader->decode(untagged, glance.stamp) == bus::Rejection::none;
    if (glance.tagged) glance.rejection = bus::Rejection::none;
  }
  return glance;
}

std::vector<MessageField> MessageReader::fields(std::span<const std::byte> message) {
  const Glance seen = glance(message);
  if (seen.type.empty() || seen.rejection != bus::Rejection::none) {
    throw std::logic_error("MessageReader: fields of a message that cannot be read");
  }
  return reader_of(seen.type)->fields();
}

}  // namespace tachless::monitor

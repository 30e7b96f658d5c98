#include "live/live_run.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <span>
#include <tuple>
#include <utility>

#include "base/json_text.h"
#include "base/text.h"
#include "bus/authenticated.h"
#include "live/arrivals.h"
#include "logger/tick_messages.h"
#include "messages/measurements.h"
#include "messages/truth/tick_record.h"
#include "messages/truth/truth_wire.h"
#include "study/tracking.h"

namespace tachless::live {
namespace {

constexpr std::size_t most_events = 16;  // of a stretch

/// A curve of each joint.
using Curves = std::vector<study::Envelope>;

/// "[[t,y,t,y],…]": the lowest and the highest value of each joint, in the order of time.
std::string extremes(const Curves& joints) {
  std::string text;
  for (const study::Envelope& joint : joints) {
    std::string points;
    for (const auto& [x, y] : joint.points(2)) {
      points += fmt::format("{}{:.9g},{:.6g}", points.empty() ? "" : ",", x, y);
    }
    text += fmt::format("{}[{}]", text.empty() ? "" : ",", points);
  }
  return "[" + text + "]";
}

/// Rate and jitter of the ticks in the newest second.
class Regularity {
 public:
  void add(std::int64_t received_ns) {
    if (last_ns_ && received_ns >= *last_ns_) {
      arrivals_.add(received_ns - *last_ns_);
      if (arrivals_.total_ns() > 1e9) {
        rate_hz = arrivals_.rate_hz().value_or(0);
        jitter_us = arrivals_.jitter_us().value_or(0);
        arrivals_ = {};
      }
    }
    last_ns_ = received_ns;
  }
  double rate_hz = 0, jitter_us = 0;

 private:
  std::optional<std::int64_t> last_ns_;
  Arrivals arrivals_;
};

}  // namespace

/// All that is known of one run.
struct LiveRun::Run {
  explicit Run(logger::RunDescription description)
      : described(std::move(description)), disturbed(logger::has_disturbance(described.scenario)) {
    const auto declared = messages::parse_signals(described.info.signals);
    for (const auto& [name, unit] : *declared) {
      signals.emplace_back(name);
    }
  }

  [[nodiscard]] double seconds(const messages::Stamp& stamp) const {
    return static_cast<double>(stamp.tick) * described.info.period_s;
  }
  void note(const std::string& curve, const messages::Stamp& stamp, const Vector& values) {
    if (values.size() != described.layout.num_joints) return;
    newest_s = std::max(newest_s, seconds(stamp));
    Curves& joints = curves[curve];
    joints.resize(static_cast<std::size_t>(values.size()));
    for (std::size_t i = 0; i < joints.size(); ++i) {
      joints[i].add(seconds(stamp), values[static_cast<Eigen::Index>(i)]);
    }
  }
  /// Keeps the first events of a stretch and counts the others.
  void note_event(std::string event) {
    if (events.size() < most_events) {
      events.push_back(std::move(event));
    } else {
      ++further_events;
    }
  }
  void note_positions(const messages::Stamp& stamp, const Vector& q, const Vector& theta) {
    note("q", stamp, q);
    note("theta", stamp, theta);
    const auto& [tick, q_ref] =
        references[static_cast<std::size_t>(stamp.tick) % references.size()];
    if (tick == stamp.tick && q_ref.size() == q.size()) note("|e|", stamp, (q - q_ref).cwiseAbs());
  }

  void on(const messages::Stamp& stamp, const messages::Tick& /*tick*/, std::int64_t received_ns) {
    newest_s = std::max(newest_s, seconds(stamp));
    ticks.add(received_ns);
  }
  void on(const messages::Stamp& stamp, const messages::ReferencePoint& reference,
          std::int64_t /*ns*/) {
    if (stamp.tick < 0) return;
    references[static_cast<std::size_t>(stamp.tick) % references.size()] = {stamp.tick,
                                                                            reference.q_ref};
    note("q_ref", stamp, reference.q_ref);
    if (reference.gains == gains) return;
    gains = reference.gains;
    note_event(fmt::format("gains from {:.4g} s: {}", seconds(stamp),
                           gains.empty() ? "the scenario's" : gains));
  }
  void on(const messages::Stamp& stamp, const messages::AnyMeasurement& any, std::int64_t /*ns*/) {
    if (truth) return;
    const Vector* const theta = messages::parts_of(any)[2];
    note_positions(stamp, messages::links_of(any), theta == nullptr ? Vector() : *theta);
  }
  void on(const messages::Stamp& stamp, const messages::TorqueCommand& command,
          std::int64_t /*ns*/) {
    if (!truth) note("τ", stamp, command.tau);
  }
  void on(const messages::Stamp& stamp, const messages::LawSignals& values, std::int64_t /*ns*/) {
    for (std::size_t i = 0; i < signals.size() && static_cast<int>(i) < values.num; ++i) {
      note(signals[i], stamp, values.value[i]);
    }
  }
  void on(const messages::Stamp& stamp, const messages::truth::PlantTruth& is,
          std::int64_t /*ns*/) {
    using messages::truth::DriveFault;
    truth = true;
    note_positions(stamp, is.q, is.theta);
    note("τ", stamp, is.tau);
    if (disturbed) note("disturbance", stamp, is.disturbance);
    for (std::size_t i = 0; i < static_cast<std::size_t>(is.tau.size()); ++i) {
      saturated[i] = saturated[i] || is.saturated[i];
    }
    if (is.fault == DriveFault::command_missed) ++missed;
    if (is.fault == DriveFault::protective_stop && fault != is.fault) {
      note_event(fmt::format("protective stop at {:.4g} s", seconds(stamp)));
    }
    fault = is.fault;
  }

  /// Notes the force, and the geoms when they begin to touch after a while without contact.
  void on(const messages::Stamp& stamp, const messages::truth::Contact& contact,
          std::int64_t /*ns*/) {
    constexpr double apart_s = 0.1;  // touches closer together are one
    Curves& force = curves["contact"];
    force.resize(1);
    force[0].add(seconds(stamp), contact.force);
    if (contact.geoms.empty()) return;
    if (!touched_s || seconds(stamp) - *touched_s > apart_s) {
      note_event(fmt::format("contact from {:.4g} s ({})", seconds(stamp),
                             base::printable(contact.geoms)));
    }
    touched_s = seconds(stamp);
  }

  void on(const messages::Stamp& stamp, const messages::Participant& participant,
          std::int64_t /*ns*/) {
    std::string& known = faults[static_cast<std::size_t>(participant.role)];
    if (participant.state != messages::ParticipantState::fault || !known.empty()) return;
    known = fmt::format("{} at tick {}: {}", name(participant.role), stamp.tick,
                        base::printable(participant.fault));
    note_event(known);
  }

  /// Reads a message of that port's type, with the tag of a key or without.
  template <class Value>
  void read(const bus::Datagram& datagram, messages::Port<Value>& port) {
    if (datagram.channel != port.channel) return;
    messages::Stamp stamp;
    Value value;
    std::span<const std::byte> payload = datagram.payload;
    messages::Rejection rejection = port.codec.decode(payload, stamp, value);
    if (rejection == messages::Rejection::wrong_size && payload.size() > bus::tag_size) {
      payload = payload.first(payload.size() - bus::tag_size);
      rejection = port.codec.decode(payload, stamp, value);
    }
    if (rejection == messages::Rejection::none && stamp.run == described.run_id) {
      on(stamp, value, datagram.received_ns);
    }
  }

  template <class Value>
  [[nodiscard]] messages::Port<Value> port() const {
    return messages::port<Value>(described.info.robot, described.layout);
  }

  logger::RunDescription described;
  bool disturbed;  ///< TRUTH has torques that no drive gives
  std::tuple<messages::Port<messages::Tick>, messages::Port<messages::ReferencePoint>,
             messages::Port<messages::TorqueCommand>, messages::Port<messages::LawSignals>,
             messages::Port<messages::truth::PlantTruth>, messages::Port<messages::truth::Contact>,
             messages::Port<messages::Participant>, messages::Port<messages::AnyMeasurement>>
      ports{port<messages::Tick>(),
            port<messages::ReferencePoint>(),
            port<messages::TorqueCommand>(),
            port<messages::LawSignals>(),
            port<messages::truth::PlantTruth>(),
            port<messages::truth::Contact>(),
            port<messages::Participant>(),
            messages::Port<messages::AnyMeasurement>{
                messages::channel(described.info.robot, described.info.measurement),
                {described.info.measurement, described.layout}}};
  std::vector<std::string> signals;
  std::map<std::string, Curves> curves;
  std::array<std::pair<std::int64_t, Vector>, 16> references;  ///< ticks and positions, of late
  bool truth = false;                                          ///< there is TRUTH on the bus
  std::optional<double> touched_s;                             ///< newest time with a contact
  double newest_s = 0;
  std::int64_t next_stretch = 0;  ///< its number
  Regularity ticks;
  std::int64_t missed = 0;
  messages::truth::DriveFault fault = messages::truth::DriveFault::none;
  std::array<bool, max_joints> saturated{};
  std::array<std::string, messages::num_roles> faults;  ///< by role, as events
  std::string gains;                                    ///< of the newest reference
  std::vector<std::string> events;                      ///< since the last stretch
  std::int64_t further_events = 0;                      ///< since then, not kept
};

LiveRun::LiveRun() = default;
LiveRun::~LiveRun() = default;

const logger::RunDescription* LiveRun::run() const { return run_ ? &run_->described : nullptr; }

void LiveRun::take(const bus::Datagram& datagram) {
  if (!datagram.channel.ends_with(logger::run_info_suffix)) {
    if (!run_) return;
    return std::apply([&](auto&... port) { (run_->read(datagram, port), ...); }, run_->ports);
  }
  if (datagram.payload.size() < messages::stamp_end ||
      messages::fingerprint_of(datagram.payload) != messages::fingerprint<messages::RunInfo>()) {
    return;
  }
  const std::int64_t id = messages::stamp_of(datagram.payload).run;
  // A scenario takes milliseconds to read, and comes again every second: one a second is read.
  if ((run_ && run_->described.run_id == id) || datagram.received_ns < next_read_ns_) return;
  next_read_ns_ = datagram.received_ns + 1'000'000'000;
  logger::RunDescription found;
  const std::string channel(datagram.channel);
  std::span<const std::byte> payload = datagram.payload;
  if (logger::read_run_info(channel, payload, channel, found).empty() ||
      (payload.size() > bus::tag_size &&
       logger::read_run_info(channel, payload.first(payload.size() - bus::tag_size), channel, found)
           .empty())) {
    run_ = std::make_unique<Run>(std::move(found));
    run_->next_stretch = datagram.received_ns / 1000;
  }
}

std::string LiveRun::stretch() {
  if (!run_ || (run_->curves.empty() && run_->events.empty())) return {};
  Run& run = *run_;
  if (const auto further = std::exchange(run.further_events, 0); further > 0) {
    run.events.push_back(fmt::format("and {} more", further));
  }
  std::string curves;
  for (const auto& [name, joints] : run.curves) {
    curves += fmt::format("{}{}:{}", curves.empty() ? "" : ",",
                          base::json_text(nlohmann::json(name)), extremes(joints));
  }
  run.curves.clear();
  std::vector<std::size_t> saturated;
  for (std::size_t i = 0; i < run.saturated.size(); ++i) {
    if (std::exchange(run.saturated[i], false)) saturated.push_back(i);
  }
  return fmt::format(
      R"({{"run":{},"number":{},"t":{:.9g},"curves":{{{}}},"rate":{:.5g},"jitter_us":{:.4g},"missed":{},)"
      R"("saturated":[{}],"events":{}}})",
      run.described.run_id, run.next_stretch++, run.newest_s, curves, run.ticks.rate_hz,
      run.ticks.jitter_us, run.missed, fmt::join(saturated, ","),
      base::json_text(nlohmann::json(std::exchange(run.events, {}))));
}

}  // namespace tachless::live

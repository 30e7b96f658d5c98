#include "logger/run_log.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <tuple>
#include <type_traits>

#include "base/failure.h"
#include "base/text.h"
#include "base/tick_ring.h"
#include "base/version.h"
#include "logger/tick_messages.h"
#include "messages/measurements.h"
#include "messages/truth/truth_wire.h"

namespace tachless::logger {
namespace {

// Number of ticks held at once. Half of them are ahead of the awaited ticks.
constexpr std::int64_t num_held = 2 * RunLog::window;

/// The fingerprint of RUN_INFO in version 0.1.0, whose messages were others.
constexpr std::int64_t run_info_of_0_1_0 = 0x2243251c415912ef;

/// Reads `reader` from where it stands up to a usable RUN_INFO, of the run `wanted`.
RunDescription find_run(LogReader& reader, std::optional<std::int64_t> wanted) {
  std::string problem;
  std::uint64_t events = 0;
  while (const auto event = reader.next()) {
    ++events;
    if (!event->channel.ends_with(run_info_suffix)) continue;
    RunDescription found;
    std::string wrong;
    if (messages::fingerprint_of(event->data) == run_info_of_0_1_0) {
      wrong = fmt::format(
          "was recorded by tachless 0.1.0; this is {0}, which reads logs of {0}; use 0.1.0 to read "
          "it",
          base::version);
    } else {
      wrong =
          read_run_info(event->channel, event->data, reader.path().string() + " (RUN_INFO)", found);
      if (wrong.empty() && wanted && found.run_id != *wanted) {
        wrong = fmt::format("is of run {}, not of run {}", found.run_id, *wanted);
      }
      if (!wrong.empty()) wrong = fmt::format("its RUN_INFO at byte {} {}", event->offset, wrong);
    }
    if (wrong.empty()) return found;
    if (problem.empty()) problem = wrong;
  }
  if (events == 0) problem = no_log_text(reader.path());
  if (problem.empty()) {
    problem = fmt::format(
        "none of its {} messages is a RUN_INFO, which says what was run; record from before the "
        "start on, or see what the log holds with: tachless info {}",
        events, reader.path().string());
  }
  throw base::bad_usage("{}: {}", reader.path().string(), problem);
}

/// Messages of one tick, decoded and as bytes of the log.
struct HeldTick {
  TickRecord record;
  std::array<std::span<const std::byte>, messages::num_slots> bytes;
  int num_messages = 0;
};

}  // namespace

std::string no_log_text(const std::filesystem::path& path) {
  std::string text(1 << 16, '\0');
  std::ifstream file(path, std::ios::binary);
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(file.gcount()));
  const auto type = [&](std::string_view verb) {
    return fmt::format("tachless {} {}", verb, base::shell_word(path.string()));
  };
  if (text.empty()) return "the file is empty; name an LCM log";
  constexpr std::string_view event_begins = "\xED\xA1\xDA\x01";  // LCM's word of synchronisation
  if (text.starts_with(event_begins)) {
    return "an LCM log that ends in its first message; name a log that was written to its end";
  }
  if (text.starts_with("\x01\xDA\xA1\xED")) {
    return "an LCM log in the wrong byte order; write its headers in network byte order";
  }
  if (text.find("<robot") != std::string::npos) {
    return "this is a robot description; type: " + type("robot");
  }
  if (text.find("\nrobot:") != std::string::npos &&
      text.find("\ncontroller:") != std::string::npos) {
    return "this is a scenario; type: " + type("run");
  }
  return "not one message of an LCM log is in it; name an LCM log";
}

std::string read_run_info(std::string_view channel, std::span<const std::byte> data,
                          const std::string& source, RunDescription& found) {
  const messages::Codec<messages::RunInfo> codec(messages::Layout{});
  messages::Stamp stamp;
  const auto rejection = codec.decode(data, stamp, found.info);
  if (rejection != messages::Rejection::none) {
    const bool longer = rejection == messages::Rejection::wrong_size;
    return fmt::format("is damaged ({}){}", messages::name(rejection),
                       longer ? ", or carries the tag of a key" : "");
  }
  found.run_id = stamp.run;
  try {
    found.scenario =
        scenario::parse_scenario(found.info.scenario, found.info.robot_description, source);
  } catch (const base::Failure& failure) {
    return fmt::format("cannot be used: {}", failure.what());
  }
  if (found.scenario.controller.law == controller::external_law_name) {
    found.scenario.controller.announced = base::printable(found.info.law);
  }
  const messages::RunInfo& info = found.info;
  const scenario::Scenario& scenario = found.scenario;
  const auto prefix = channel.substr(0, channel.size() - run_info_suffix.size());
  if (info.robot != prefix || scenario.robot.channel_prefix != prefix) {
    return fmt::format("names robot {} on channel {}{}", info.robot, prefix, run_info_suffix);
  }
  if (info.num_ticks != scenario.loop.num_ticks || info.period_s != scenario.loop.period_s) {
    return "contradicts the scenario in it on the number or the length of ticks";
  }
  if (!messages::with_measurement(info.measurement, [](auto) {})) {
    return "names an unknown measurement, " + info.measurement;
  }
  const auto signals = messages::parse_signals(info.signals);
  if (!signals) {
    return fmt::format("declares the law's signals as \"{}\", which is not name:unit,...",
                       info.signals);
  }
  found.layout = messages::layout(scenario.num_joints, scenario.robot.flexible.has_value(),
                                  static_cast<int>(signals->size()));
  return {};
}

std::uint64_t RunSummary::gaps() const {
  std::uint64_t sum = 0;
  for (const auto& piece : pieces) {
    if (!piece.absent()) sum += piece.missing.count;
  }
  return sum;
}

std::string RunSummary::stop_reason(std::int64_t num_ticks) const {
  // Before the run begins, a process may fail and another take its place.
  const bool replaced = plant_finished && stop && stop->tick < 0;
  if (stop && !replaced) return stop->text.empty() ? "no reason given" : stop->text;
  if (plant_finished || last_tick + 1 >= num_ticks) return {};
  return fmt::format("the log ends after {} of {} ticks and does not say why", last_tick + 1,
                     num_ticks);
}

std::vector<std::string> RunSummary::gap_texts() const {
  std::vector<std::string> texts;
  for (const auto& piece : pieces) {
    if (piece.channel.empty()) continue;
    if (piece.absent()) {
      texts.push_back("no " + piece.channel);
    } else if (piece.missing.count != 0) {
      texts.push_back(fmt::format("{} missing in {} ticks", piece.channel, piece.missing.count));
    }
  }
  return texts;
}

void append_cause(const std::filesystem::path& log, const scenario::Scenario& scenario,
                  std::int64_t run, const ParticipantFault& cause, base::ExitCode code) {
  messages::Participant who;
  who.role = cause.role;
  who.state = messages::ParticipantState::fault;
  who.instance = launcher_instance;
  who.scenario_digest = scenario.digest;
  who.fault_code = static_cast<int>(code);
  who.fault = base::printable(cause.text).substr(0, messages::max_participant_text);
  messages::Codec<messages::Participant> codec(messages::Layout{});
  append_event(log, messages::channel<messages::Participant>(scenario.robot.channel_prefix),
               codec.encode({0, run, cause.tick}, who));
}

/// Puts the messages of a log into their ticks.
class RunLog::Window {
 public:
  /// @param held ticks of the previous window, whose pages (some megabytes) are costly to allocate
  explicit Window(RunLog& log, base::TickRing<HeldTick> held)
      : reader_(log.reader_),
        described_(log.described_),
        on_event_(log.on_event_),
        summary_(log.summary_),
        held_(std::move(held)) {
    std::apply([&](auto&... channel) { (make(channel), ...); }, channels_);
    last_seen_.fill(-1);
  }

  /// Gives its ticks, cleared, to the window that follows.
  base::TickRing<HeldTick> take_held() {
    held_.fill(none_);
    return std::move(held_);
  }

  bool next(TickRecord& record) {
    for (;;) {
      if (base_ < release_below_) {
        if (newest_ < base_) {
          base_ = release_below_;
          continue;
        }
        HeldTick& held = held_[base_++];
        if (held.num_messages == 0) continue;
        const bool begun = has_begun(held);
        if (begun) {
          count(held.record);
          record = held.record;
        }
        held = none_;
        if (begun) return true;
      } else if (ready_) {
        take(*std::exchange(ready_, std::nullopt));
      } else if (const auto event = reader_.next()) {
        if (on_event_) on_event_(*event);
        take(*event);
      } else {
        at_end_ = true;
        if (newest_ < base_) break;
        release_below_ = newest_ + 1;
      }
    }
    if (!std::exchange(finished_, true)) {
      for (const Slot slot : messages::all_slots) finish(slot);
    }
    return false;
  }

 private:
  template <class Value>
  struct Channel {
    std::string name;
    std::optional<messages::Codec<Value>> codec;  ///< nothing: its messages are not read
    Value scratch;
  };
  template <class... Value>
  static std::tuple<Channel<Value>...> channels_of(messages::TypeList<Value...>);
  template <class Value>
  void make(Channel<Value>& channel) {
    if (messages::is_measurement<Value> && described_.info.measurement != Value::suffix) return;
    if (std::is_same_v<Value, messages::LogAck>) return;  // the message tells nothing of a run
    if constexpr (messages::once_per_tick<Value>) {
      if (!has_slot(described_.scenario, messages::slot_of<Value>())) return;
    }
    channel.name = messages::channel<Value>(described_.info.robot);
    channel.codec.emplace(described_.layout);
    if constexpr (messages::once_per_tick<Value>) {
      piece(messages::slot_of<Value>()).channel = channel.name;
    }
  }

  PieceSummary& piece(Slot slot) { return summary_.pieces[index(slot)]; }

  /// Returns false for a tick that has only a reference, at the end of a run that was cut short.
  /// The reference is a tick ahead.
  [[nodiscard]] bool has_begun(const HeldTick& held) const {
    const std::int64_t tick = held.record.tick;
    return !at_end_ || ready_ || tick != newest_ || summary_.last_tick < 0 ||
           summary_.last_tick != tick - 1 || held.num_messages != 1 || !held.record.reference;
  }

  void take(const LogEvent& event) {
    const auto take_from = [&](auto& channel) {
      if (!channel.codec || channel.name != event.channel) return false;
      take(event, channel);
      return true;
    };
    std::apply([&](auto&... channel) { (void)(take_from(channel) || ...); }, channels_);
  }

  template <class Value>
  void take(const LogEvent& event, Channel<Value>& channel) {
    messages::Stamp stamp;
    const auto rejection = channel.codec->decode(event.data, stamp, channel.scratch);
    // Another run may have another number of joints, so the run counts before the size.
    if (is_foreign(event, std::is_same_v<Value, messages::Participant>)) return;
    if (rejection != messages::Rejection::none) {
      ++summary_.undecodable[rejection];
      return;
    }
    if constexpr (messages::once_per_tick<Value>) {
      if (TickRecord* record = place(event, stamp, messages::slot_of<Value>())) {
        messages::put(*record, channel.scratch);
      }
    } else if constexpr (std::is_same_v<Value, messages::Participant>) {
      note_end(stamp, channel.scratch);
    }
  }

  /// Returns true if the message is of another run. A process that has not joined a run announces
  /// itself in run 0.
  bool is_foreign(const LogEvent& event, bool announcement) {
    if (event.data.size() < messages::stamp_end) return false;
    const std::int64_t run = messages::stamp_of(event.data).run;
    if (run == described_.run_id || (announcement && run == 0)) return false;
    ++summary_.foreign_messages;
    auto& runs = summary_.foreign_runs;
    if (runs.size() < RunSummary::max_listed || runs.contains(run)) ++runs[run];
    return true;
  }

  /// Returns the record that a message belongs to. Returns null for a message that is not used,
  /// or not yet.
  TickRecord* place(const LogEvent& event, const messages::Stamp& stamp, Slot slot) {
    const std::int64_t num_ticks = described_.info.num_ticks;
    // The reference answers one tick ahead, so its last message may lie past the end of the run.
    const bool past_end = slot == Slot::reference && stamp.tick == num_ticks;
    if (stamp.tick < 0 || (stamp.tick >= num_ticks && !past_end) || !time_agrees(stamp)) {
      ++summary_.wrong_tick;
      return nullptr;
    }
    if (past_end) return nullptr;
    if (stamp.tick < base_) {
      ++summary_.too_late;
      return nullptr;
    }
    if (stamp.tick >= base_ + num_held) {
      // A damaged number must not make the window run away from the ticks that follow.
      if (static_cast<double>(stamp.utime) < time_us(stamp) - 1) {
        ++summary_.wrong_tick;
      } else {
        release_below_ = std::max(release_below_, stamp.tick - window);
        ready_ = event;
      }
      return nullptr;
    }
    newest_ = std::max(newest_, stamp.tick);
    release_below_ = std::max(release_below_, newest_ - window);
    HeldTick& held = held_[stamp.tick];
    const auto fields = event.data.subspan(messages::stamp_end);
    auto& bytes = held.bytes[index(slot)];
    if (has(held.record, slot)) {
      const bool same = std::ranges::equal(bytes, fields);
      ++(same ? piece(slot).duplicates : piece(slot).conflicts);
      return nullptr;
    }
    bytes = fields;
    ++held.num_messages;
    held.record.tick = stamp.tick;
    return &held.record;
  }

  /// Returns the planned time of the tick [us].
  [[nodiscard]] double time_us(const messages::Stamp& stamp) const {
    return static_cast<double>(stamp.tick) * described_.info.period_s * 1e6;
  }
  /// Returns false in lockstep when time and tick disagree, as after damage to one of them.
  [[nodiscard]] bool time_agrees(const messages::Stamp& stamp) const {
    return described_.scenario.loop.mode != scenario::Mode::lockstep ||
           std::abs(static_cast<double>(stamp.utime) - time_us(stamp)) <= 1;
  }

  /// Notes what an announcement says of the run's end.
  void note_end(const messages::Stamp& stamp, const messages::Participant& who) {
    const bool failed = who.state == messages::ParticipantState::fault;
    // A process that has not joined the run announces its fault in run 0.
    if (stamp.run == described_.run_id) {
      auto& stop = summary_.stop;
      if (who.role == messages::Role::plant && who.state == messages::ParticipantState::finished) {
        summary_.plant_finished = true;
      } else if ((failed || !who.fault.empty()) && (!stop || who.instance == launcher_instance)) {
        stop = {who.role, stop ? stop->tick : stamp.tick, who.fault};
      }
    }
    auto& faults = summary_.faults;
    if (!failed || faults.size() >= RunSummary::max_listed) return;
    const bool known = std::ranges::any_of(faults, [&](const ParticipantFault& fault) {
      return fault.role == who.role && fault.text == who.fault;
    });
    if (!known) faults.push_back({who.role, stamp.tick, who.fault});
  }

  void count(const TickRecord& record) {
    if (summary_.first_tick < 0) summary_.first_tick = record.tick;
    summary_.last_tick = record.tick;
    ++summary_.ticks;
    if (record.reference && record.reference->gains != gains_) {
      gains_ = record.reference->gains;
      auto& changes = summary_.gains;
      if (changes.size() < RunSummary::max_listed) changes.push_back({record.tick, gains_});
    }
    for (const Slot slot : messages::all_slots) {
      if (!has(record, slot)) continue;
      ++piece(slot).count;
      count_missing(slot, record.tick);
      last_seen_[index(slot)] = record.tick;
    }
  }

  void finish(Slot slot) {
    count_missing(slot, summary_.last_tick + 1);
    if (may_be_absent(slot) && piece(slot).absent()) piece(slot).channel.clear();
  }

  /// Counts the ticks that lack the piece, after the last tick that had it and before `tick`.
  void count_missing(Slot slot, std::int64_t tick) {
    std::int64_t last = tick - 1;
    if (summary_.stop && described_.scenario.loop.mode == scenario::Mode::realtime) {
      last = std::min(last, std::max<std::int64_t>(summary_.stop->tick, -1));
    }
    const TickRange range{last_seen_[index(slot)] + 1, last};
    if (range.first <= range.last) piece(slot).missing.add(range);
  }

  LogReader& reader_;
  const RunDescription& described_;
  const std::function<void(const LogEvent&)>& on_event_;
  RunSummary& summary_;
  decltype(channels_of(messages::AllMessages())) channels_;
  const HeldTick none_{};  ///< source of assignments; {} would first be cleared byte by byte
  base::TickRing<HeldTick> held_;
  std::int64_t base_ = 0;           // ticks below it are handed out or will not come
  std::int64_t release_below_ = 0;  // ticks below it are to be handed out
  std::int64_t newest_ = -1;        // highest tick that is held
  std::optional<LogEvent> ready_;   // event to place after the ticks below `release_below_`
  bool at_end_ = false;             // the file has been read to its end
  bool finished_ = false;
  std::array<std::int64_t, messages::num_slots> last_seen_{};
  std::string gains_;  ///< of the last reference handed out
};

RunLog::RunLog(const std::filesystem::path& path, std::optional<std::int64_t> run)
    : reader_(path), described_(find_run(reader_, run)) {
  rewind();
}
RunLog::~RunLog() = default;

bool RunLog::next(TickRecord& record) { return window_->next(record); }

void RunLog::rewind() {
  reader_.rewind();
  summary_ = {};
  window_ = std::make_unique<Window>(
      *this, window_ ? window_->take_held() : base::TickRing<HeldTick>(num_held));
}

}  // namespace tachless::logger

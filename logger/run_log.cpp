#include "logger/run_log.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <deque>
#include <stdexcept>
#include <tuple>
#include <type_traits>
#include <utility>

#include "bus/truth/truth_wire.h"
#include "diagnostics/failure.h"

namespace tachless::logger {
namespace {

// Fingerprint, utime, run, tick: what every message of ours begins with.
constexpr std::size_t stamp_bytes = 32;
constexpr std::size_t run_at = 16;
// Ticks held at once: those waited for, and as many ahead of them.
constexpr std::int64_t num_slots = 2 * RunLog::window;
// Messages farther ahead that are kept until another one bears them out: a damaged tick number
// must not make the window run away from the ticks that follow.
constexpr std::size_t max_ahead = 64;
constexpr std::string_view run_info_suffix = "_RUN_INFO";

[[noreturn]] void refuse(const std::filesystem::path& path, const std::string& problem) {
  throw diagnostics::Failure(diagnostics::ExitCode::bad_usage, path.string() + ": " + problem);
}

std::int64_t big_endian_int64(std::span<const std::byte> from, std::size_t at) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < 8; ++i)
    value = value << 8 | std::to_integer<std::uint64_t>(from[at + i]);
  return static_cast<std::int64_t>(value);
}

bool same(const loop::Tick& a, const loop::Tick& b) { return a.last == b.last; }
bool same(const robot::Vector& a, const robot::Vector& b) {
  return a.size() == b.size() &&
         std::memcmp(a.data(), b.data(), sizeof(double) * static_cast<std::size_t>(a.size())) == 0;
}
bool same(const loop::PositionMeasurement& a, const loop::PositionMeasurement& b) {
  return same(a.q, b.q);
}
bool same(const loop::MotorPositionMeasurement& a, const loop::MotorPositionMeasurement& b) {
  return same(a.theta, b.theta);
}
bool same(const loop::LinkStateMeasurement& a, const loop::LinkStateMeasurement& b) {
  return same(a.q, b.q) && same(a.v, b.v) && same(a.theta, b.theta);
}
bool same(const loop::StateMeasurement& a, const loop::StateMeasurement& b) {
  return same(a.q, b.q) && same(a.v, b.v) && same(a.theta, b.theta) && same(a.thetadot, b.thetadot);
}
bool same(const loop::ReferencePoint& a, const loop::ReferencePoint& b) {
  return same(a.q_ref, b.q_ref) && same(a.v_ref, b.v_ref) && same(a.a_ref, b.a_ref) &&
         same(a.jerk_ref, b.jerk_ref) && same(a.snap_ref, b.snap_ref);
}
bool same(const loop::TorqueCommand& a, const loop::TorqueCommand& b) { return same(a.tau, b.tau); }
bool same(const loop::LawSignals& a, const loop::LawSignals& b) {
  if (a.num != b.num) return false;
  for (std::size_t i = 0; i < static_cast<std::size_t>(a.num); ++i) {
    if (!same(a.value[i], b.value[i])) return false;
  }
  return true;
}
bool same(const loop::truth::PlantTruth& a, const loop::truth::PlantTruth& b) {
  return same(a.q, b.q) && same(a.v, b.v) && same(a.theta, b.theta) &&
         same(a.thetadot, b.thetadot) && same(a.tau, b.tau) && a.saturated == b.saturated &&
         a.fault == b.fault;
}

void clear(TickRecord& record) {
  record.clock.reset();
  record.measurement.emplace<std::monostate>();
  record.reference.reset();
  record.command.reset();
  record.controller_state.reset();
  record.truth.reset();
}

template <class Value>
Value* get(std::optional<Value>& slot) {
  return slot ? &*slot : nullptr;
}
template <class Value>
Value* get(Measurement& slot) {
  return std::get_if<Value>(&slot);
}

}  // namespace

bool has(const TickRecord& record, Piece piece) {
  switch (piece) {
    case Piece::clock:
      return record.clock.has_value();
    case Piece::measurement:
      return !std::holds_alternative<std::monostate>(record.measurement);
    case Piece::reference:
      return record.reference.has_value();
    case Piece::command:
      return record.command.has_value();
    case Piece::controller_state:
      return record.controller_state.has_value();
    case Piece::truth:
      return record.truth.has_value();
  }
  throw std::logic_error("logger::has: no such piece");
}

std::uint64_t RunSummary::gaps() const {
  std::uint64_t sum = 0;
  for (const auto& piece : pieces) {
    if (!piece.absent()) sum += piece.missing;
  }
  return sum;
}

class RunLog::Impl {
 public:
  Impl(const std::filesystem::path& path, std::optional<std::int64_t> run) : reader_(path) {
    find_run_info(run);
    layout_ = loop::layout(scenario_.num_joints, scenario_.robot.flexible.has_value(),
                           static_cast<int>(loop::parse_signals(info_.signals)->size()));
    make_codecs();
    slots_.resize(static_cast<std::size_t>(num_slots));
    rewind();
  }

  bool next(TickRecord& record) {
    for (;;) {
      if (base_ < release_below_) {
        if (newest_ < base_) {
          base_ = release_below_;
          continue;
        }
        TickRecord& slot = slot_of(base_++);
        if (!any_piece(slot)) continue;
        if (has_not_begun(slot)) {
          clear(slot);
          continue;
        }
        count(slot);
        record = slot;
        clear(slot);
        return true;
      }
      if (!ready_.empty()) {
        const LogEvent event = ready_.front();
        ready_.pop_front();
        take(event);
      } else if (const auto event = reader_.next()) {
        take(*event);
      } else if (at_end_ = true; newest_ >= base_) {
        release_below_ = newest_ + 1;
      } else if (!ahead_.empty()) {
        // Nothing comes before what is ahead any more.
        release_below_ =
            std::min_element(ahead_.begin(), ahead_.end(), [](const Ahead& a, const Ahead& b) {
              return a.tick < b.tick;
            })->tick;
        admit_ahead();
      } else {
        finish();
        return false;
      }
    }
  }

  void rewind() {
    reader_.rewind();
    base_ = 0;
    release_below_ = 0;
    newest_ = -1;
    at_end_ = false;
    finished_ = false;
    ahead_.clear();
    ready_.clear();
    for (TickRecord& slot : slots_) clear(slot);
    summary_ = {};
    last_seen_.fill(-1);
    for (const Piece piece : all_pieces) piece_summary(piece).channel = channel_of(piece);
  }

  [[nodiscard]] const LogReader& reader() const { return reader_; }
  [[nodiscard]] std::int64_t run() const { return run_; }
  [[nodiscard]] const loop::RunInfo& info() const { return info_; }
  [[nodiscard]] const experiment::Scenario& scenario() const { return scenario_; }
  [[nodiscard]] const loop::Layout& layout() const { return layout_; }
  [[nodiscard]] const RunSummary& summary() const { return summary_; }

 private:
  template <class Value>
  struct Channel {
    std::string name;
    std::optional<bus::Codec<Value>> codec;
    Value scratch;
  };

  void find_run_info(std::optional<std::int64_t> wanted) {
    const bus::Codec<loop::RunInfo> codec(loop::Layout{1, 0, 0});
    std::string problem;
    std::uint64_t events = 0;
    std::optional<std::tuple<loop::RunInfo, experiment::Scenario, std::int64_t>> fallback;
    while (const auto event = reader_.next()) {
      ++events;
      if (!event->channel.ends_with(run_info_suffix)) continue;
      loop::Stamp stamp;
      const auto rejection = codec.decode(event->data, stamp, info_);
      const auto complain = [&](const std::string& what) {
        if (problem.empty()) {
          problem = "its RUN_INFO at byte " + std::to_string(event->offset) + " " + what;
        }
      };
      if (rejection != bus::Rejection::none) {
        complain("is damaged (" + std::string(bus::name(rejection)) + ")");
        continue;
      }
      if (wanted && stamp.run != *wanted) {
        complain("is of run " + std::to_string(stamp.run) + ", not of run " +
                 std::to_string(*wanted));
        continue;
      }
      const std::string prefix(
          event->channel.substr(0, event->channel.size() - run_info_suffix.size()));
      try {
        scenario_ = experiment::parse_scenario(info_.scenario, info_.robot_description,
                                               reader_.path().string() + " (RUN_INFO)");
      } catch (const diagnostics::Failure& failure) {
        complain(std::string("cannot be used: ") + failure.what());
        continue;
      }
      if (info_.robot != prefix || scenario_.robot.channel_prefix != prefix) {
        complain("names robot " + info_.robot + " on channel " + std::string(event->channel));
        continue;
      }
      if (info_.num_ticks != scenario_.loop.num_ticks ||
          info_.period_s != scenario_.loop.period_s) {
        complain("contradicts the scenario in it on the number or the length of ticks");
        continue;
      }
      if (!known_measurement()) {
        complain("names an unknown measurement, " + info_.measurement);
        continue;
      }
      if (!loop::parse_signals(info_.signals)) {
        complain("declares the law's signals as \"" + info_.signals +
                 "\", which is not name:unit,...");
        continue;
      }
      run_ = stamp.run;
      if (has_messages()) return;
      // A run nobody else took part in; its id may be damaged. Is there a better one?
      if (!fallback) fallback = {info_, scenario_, run_};
    }
    if (fallback) {
      std::tie(info_, scenario_, run_) = std::move(*fallback);
      return;
    }
    if (problem.empty()) {
      problem = "none of its " + std::to_string(events) +
                " messages is a RUN_INFO, which says what was run; record from before the start "
                "on, or see what the log holds with: tachless info " +
                reader_.path().string();
    }
    refuse(reader_.path(), problem);
  }

  /// Whether the log holds any message of this robot and run but RUN_INFO.
  [[nodiscard]] bool has_messages() const {
    LogReader reader(reader_.path());
    while (const auto event = reader.next()) {
      if (event->channel.starts_with(info_.robot + "_") && event->data.size() >= stamp_bytes &&
          !event->channel.ends_with(run_info_suffix) &&
          big_endian_int64(event->data, run_at) == run_) {
        return true;
      }
    }
    return false;
  }

  [[nodiscard]] bool known_measurement() const {
    return info_.measurement == loop::ChannelOf<loop::PositionMeasurement>::suffix ||
           info_.measurement == loop::ChannelOf<loop::MotorPositionMeasurement>::suffix ||
           info_.measurement == loop::ChannelOf<loop::LinkStateMeasurement>::suffix ||
           info_.measurement == loop::ChannelOf<loop::StateMeasurement>::suffix;
  }

  template <class Value>
  void make(Channel<Value>& channel) {
    channel.name = loop::channel<Value>(info_.robot);
    channel.codec.emplace(layout_);
  }

  template <class Value>
  void make_measurement(Channel<Value>& channel) {
    if (info_.measurement == loop::ChannelOf<Value>::suffix) make(channel);
  }

  void make_codecs() {
    make(clock_);
    make(reference_);
    make(command_);
    make(controller_state_);
    make(truth_);
    make(participant_);
    make(run_info_);
    make_measurement(position_);
    make_measurement(motor_position_);
    make_measurement(link_state_);
    make_measurement(state_);
  }

  [[nodiscard]] std::string channel_of(Piece piece) const {
    switch (piece) {
      case Piece::clock:
        return clock_.name;
      case Piece::measurement:
        return info_.robot + "_" + info_.measurement;
      case Piece::reference:
        return reference_.name;
      case Piece::command:
        return command_.name;
      case Piece::controller_state:
        return controller_state_.name;
      case Piece::truth:
        return truth_.name;
    }
    throw std::logic_error("logger::RunLog: no such piece");
  }

  PieceSummary& piece_summary(Piece piece) {
    return summary_.pieces[static_cast<std::size_t>(piece)];
  }

  TickRecord& slot_of(std::int64_t tick) {
    return slots_[static_cast<std::size_t>(tick % num_slots)];
  }

  static bool any_piece(const TickRecord& record) {
    return std::any_of(all_pieces.begin(), all_pieces.end(),
                       [&](Piece piece) { return has(record, piece); });
  }

  /// A run that was cut short leaves the reference of the tick after its last: it is a tick ahead.
  [[nodiscard]] bool has_not_begun(const TickRecord& record) const {
    return at_end_ && ready_.empty() && ahead_.empty() && record.tick == newest_ &&
           summary_.last_tick >= 0 && summary_.last_tick == record.tick - 1 &&
           std::all_of(all_pieces.begin(), all_pieces.end(), [&](Piece piece) {
             return has(record, piece) == (piece == Piece::reference);
           });
  }

  void take(const LogEvent& event) {
    const auto& channel = event.channel;
    if (channel == clock_.name) {
      take(event, clock_, Piece::clock, &TickRecord::clock);
    } else if (channel == reference_.name) {
      take(event, reference_, Piece::reference, &TickRecord::reference);
    } else if (channel == command_.name) {
      take(event, command_, Piece::command, &TickRecord::command);
    } else if (channel == controller_state_.name) {
      take(event, controller_state_, Piece::controller_state, &TickRecord::controller_state);
    } else if (channel == truth_.name) {
      take(event, truth_, Piece::truth, &TickRecord::truth);
    } else if (channel == position_.name) {
      take(event, position_, Piece::measurement, &TickRecord::measurement);
    } else if (channel == motor_position_.name) {
      take(event, motor_position_, Piece::measurement, &TickRecord::measurement);
    } else if (channel == link_state_.name) {
      take(event, link_state_, Piece::measurement, &TickRecord::measurement);
    } else if (channel == state_.name) {
      take(event, state_, Piece::measurement, &TickRecord::measurement);
    } else if (channel == participant_.name) {
      take_participant(event);
    } else if (channel == run_info_.name) {
      loop::Stamp stamp;
      if (decoded(event, run_info_, stamp)) ++summary_.run_infos;
    } else {
      ++summary_.other_messages;
    }
  }

  template <class Value>
  bool decoded(const LogEvent& event, Channel<Value>& channel, loop::Stamp& stamp) {
    const auto rejection = channel.codec->decode(event.data, stamp, channel.scratch);
    // Another run may have another number of joints: look at the run even where the size is wrong.
    const bool stamped = event.data.size() >= stamp_bytes;
    const std::int64_t run = stamped ? big_endian_int64(event.data, run_at) : run_;
    const bool participant = std::is_same_v<Value, loop::Participant> && run == 0;
    if (run != run_ && !participant) {
      ++summary_.foreign_messages;
      if (summary_.foreign_runs.size() < RunSummary::max_listed ||
          summary_.foreign_runs.contains(run)) {
        ++summary_.foreign_runs[run];
      }
      return false;
    }
    if (rejection != bus::Rejection::none) {
      ++summary_.undecodable[rejection];
      return false;
    }
    return true;
  }

  template <class Value, class Slot>
  void take(const LogEvent& event, Channel<Value>& channel, Piece piece, Slot TickRecord::*member) {
    loop::Stamp stamp;
    if (!decoded(event, channel, stamp)) return;
    // The reference answers one tick ahead, so that one may lie just past the end of the run.
    const bool past_end =
        std::is_same_v<Value, loop::ReferencePoint> && stamp.tick == info_.num_ticks;
    if (stamp.tick < 0 || stamp.tick > info_.num_ticks ||
        (stamp.tick == info_.num_ticks && !past_end) || !time_agrees(stamp)) {
      ++summary_.wrong_tick;
      return;
    }
    if (past_end) return;
    if (stamp.tick < base_) {
      ++summary_.too_late;
      return;
    }
    if (stamp.tick >= base_ + num_slots) {
      keep_ahead(event, stamp.tick);
      return;
    }
    newest_ = std::max(newest_, stamp.tick);
    release_below_ = std::max(release_below_, newest_ - window);
    TickRecord& record = slot_of(stamp.tick);
    Slot& slot = record.*member;
    if (const Value* old = get<Value>(slot)) {
      auto& summary = piece_summary(piece);
      ++(same(*old, channel.scratch) ? summary.duplicates : summary.conflicts);
      return;
    }
    record.tick = stamp.tick;
    slot = channel.scratch;
  }

  /// In lockstep, time is the tick's: a number that was damaged gives itself away.
  [[nodiscard]] bool time_agrees(const loop::Stamp& stamp) const {
    if (scenario_.loop.mode != experiment::Mode::lockstep) return true;
    const double t_us = static_cast<double>(stamp.tick) * info_.period_s * 1e6;
    return std::abs(static_cast<double>(stamp.utime) - t_us) <= 1;
  }

  void keep_ahead(const LogEvent& event, std::int64_t tick) {
    for (const Ahead& other : ahead_) {
      if (std::abs(other.tick - tick) < window &&
          (other.tick != tick || other.event.channel != event.channel)) {
        // Two agree: the log does go on there.
        release_below_ = std::max(release_below_, std::max(other.tick, tick) - window);
        ahead_.push_back({event, tick});
        admit_ahead();
        return;
      }
    }
    if (ahead_.size() == max_ahead) {
      ahead_.pop_front();
      ++summary_.wrong_tick;
    }
    ahead_.push_back({event, tick});
  }

  /// Looks at the messages ahead again, once what is below `release_below_` is handed out.
  void admit_ahead() {
    std::stable_sort(ahead_.begin(), ahead_.end(),
                     [](const Ahead& a, const Ahead& b) { return a.tick < b.tick; });
    for (const Ahead& ahead : ahead_) ready_.push_back(ahead.event);
    ahead_.clear();
  }

  void take_participant(const LogEvent& event) {
    loop::Stamp stamp;
    if (!decoded(event, participant_, stamp)) return;
    const loop::Participant& who = participant_.scratch;
    if (who.state != loop::ParticipantState::fault ||
        summary_.faults.size() >= RunSummary::max_listed) {
      return;
    }
    const bool known = std::any_of(
        summary_.faults.begin(), summary_.faults.end(),
        [&](const auto& fault) { return fault.role == who.role && fault.text == who.fault; });
    if (!known) summary_.faults.push_back({who.role, stamp.tick, who.fault});
  }

  void count(const TickRecord& record) {
    if (summary_.first_tick < 0) summary_.first_tick = record.tick;
    summary_.last_tick = record.tick;
    ++summary_.ticks;
    for (const Piece piece : all_pieces) {
      if (!has(record, piece)) continue;
      ++piece_summary(piece).count;
      count_missing(piece, record.tick);
      last_seen_[static_cast<std::size_t>(piece)] = record.tick;
    }
  }

  /// Ticks from the one after the last that had `piece` to the one before `tick`.
  void count_missing(Piece piece, std::int64_t tick) {
    const TickRange range{last_seen_[static_cast<std::size_t>(piece)] + 1, tick - 1};
    if (range.first > range.last) return;
    auto& summary = piece_summary(piece);
    summary.missing += static_cast<std::uint64_t>(range.last - range.first + 1);
    if (summary.missing_list.size() < RunSummary::max_listed) summary.missing_list.push_back(range);
  }

  void finish() {
    if (std::exchange(finished_, true)) return;
    for (const Piece piece : all_pieces) count_missing(piece, summary_.last_tick + 1);
  }

  struct Ahead {
    LogEvent event;
    std::int64_t tick;
  };

  LogReader reader_;
  std::int64_t run_ = 0;
  loop::RunInfo info_;
  experiment::Scenario scenario_;
  loop::Layout layout_;
  RunSummary summary_;

  Channel<loop::Tick> clock_;
  Channel<loop::PositionMeasurement> position_;
  Channel<loop::MotorPositionMeasurement> motor_position_;
  Channel<loop::LinkStateMeasurement> link_state_;
  Channel<loop::StateMeasurement> state_;
  Channel<loop::ReferencePoint> reference_;
  Channel<loop::TorqueCommand> command_;
  Channel<loop::LawSignals> controller_state_;
  Channel<loop::truth::PlantTruth> truth_;
  Channel<loop::Participant> participant_;
  Channel<loop::RunInfo> run_info_;

  std::vector<TickRecord> slots_;
  std::int64_t base_ = 0;           // ticks below it are handed out or will not come
  std::int64_t release_below_ = 0;  // ticks below it are to be handed out
  std::int64_t newest_ = -1;        // highest tick in a slot
  std::deque<Ahead> ahead_;
  std::deque<LogEvent> ready_;
  bool at_end_ = false;  // the file has been read to its end
  bool finished_ = false;
  std::array<std::int64_t, num_pieces> last_seen_{};
};

RunLog::RunLog(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
RunLog::RunLog(RunLog&&) noexcept = default;
RunLog::~RunLog() = default;

RunLog RunLog::open(const std::filesystem::path& path, std::optional<std::int64_t> run) {
  return RunLog(std::make_unique<Impl>(path, run));
}

const std::filesystem::path& RunLog::path() const { return impl_->reader().path(); }
std::int64_t RunLog::run() const { return impl_->run(); }
const loop::RunInfo& RunLog::info() const { return impl_->info(); }
const experiment::Scenario& RunLog::scenario() const { return impl_->scenario(); }
const loop::Layout& RunLog::layout() const { return impl_->layout(); }
bool RunLog::next(TickRecord& record) { return impl_->next(record); }
void RunLog::rewind() { impl_->rewind(); }
const RunSummary& RunLog::summary() const { return impl_->summary(); }
const Damage& RunLog::damage() const { return impl_->reader().damage(); }

}  // namespace tachless::logger

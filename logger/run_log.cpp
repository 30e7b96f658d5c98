#include "logger/run_log.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <tuple>
#include <type_traits>
#include <utility>

#include "bus/truth/truth_wire.h"
#include "logger/run_info.h"

namespace tachless::logger {
namespace {

// Ticks held at once: those waited for, and as many ahead of them.
constexpr std::int64_t num_held = 2 * RunLog::window;
// Messages farther ahead that are kept until another one bears them out: a damaged tick number
// must not make the window run away from the ticks that follow.
constexpr std::size_t max_ahead = 64;

constexpr std::size_t index(Slot slot) { return static_cast<std::size_t>(slot); }

template <class Value>
constexpr bool in_tick =
    !std::is_same_v<Value, loop::Participant> && !std::is_same_v<Value, loop::RunInfo>;

void clear(TickRecord& record) {
  record.clock.reset();
  record.measurement.emplace<std::monostate>();
  record.reference.reset();
  record.command.reset();
  record.controller_state.reset();
  record.truth.reset();
}

}  // namespace

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
    described_ = find_run(reader_, run);
    std::apply([&](auto&... channel) { (make(channel), ...); }, channels_);
    slots_.resize(static_cast<std::size_t>(num_held));
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
        if (on_event_) on_event_(*event);
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
    for (const Slot slot : loop::all_slots)
      piece_summary(slot).channel = piece_channels_[index(slot)];
  }

  void watch(std::function<void(const LogEvent&)> on_event) { on_event_ = std::move(on_event); }

  [[nodiscard]] const LogReader& reader() const { return reader_; }
  [[nodiscard]] std::int64_t run() const { return described_.run; }
  [[nodiscard]] const loop::RunInfo& info() const { return described_.info; }
  [[nodiscard]] const experiment::Scenario& scenario() const { return described_.scenario; }
  [[nodiscard]] const loop::Layout& layout() const { return described_.layout; }
  [[nodiscard]] const RunSummary& summary() const { return summary_; }

 private:
  template <class Value>
  struct Channel {
    std::string name;  ///< empty: a measurement that this run has not
    std::optional<bus::Codec<Value>> codec;
    Value scratch;
  };
  template <class... Value>
  static std::tuple<Channel<Value>...> channels_of(loop::TypeList<Value...>);
  using Channels =
      decltype(std::tuple_cat(channels_of(loop::Measurements()), channels_of(loop::TickMessages()),
                              channels_of(loop::TypeList<loop::Participant, loop::RunInfo>())));

  template <class Value>
  void make(Channel<Value>& channel) {
    if (loop::is_measurement<Value> && info().measurement != loop::MessageOf<Value>::suffix) return;
    channel.name = loop::channel<Value>(info().robot);
    channel.codec.emplace(layout());
    if constexpr (in_tick<Value>) piece_channels_[index(loop::slot_of<Value>())] = channel.name;
  }

  PieceSummary& piece_summary(Slot piece) { return summary_.pieces[index(piece)]; }

  TickRecord& slot_of(std::int64_t tick) {
    return slots_[static_cast<std::size_t>(tick % num_held)];
  }

  static bool any_piece(const TickRecord& record) {
    return std::any_of(loop::all_slots.begin(), loop::all_slots.end(),
                       [&](Slot piece) { return has(record, piece); });
  }

  /// A run that was cut short leaves the reference of the tick after its last: it is a tick ahead.
  [[nodiscard]] bool has_not_begun(const TickRecord& record) const {
    return at_end_ && ready_.empty() && ahead_.empty() && record.tick == newest_ &&
           summary_.last_tick >= 0 && summary_.last_tick == record.tick - 1 &&
           std::all_of(loop::all_slots.begin(), loop::all_slots.end(), [&](Slot piece) {
             return has(record, piece) == (piece == Slot::reference);
           });
  }

  void take(const LogEvent& event) {
    const bool ours = std::apply(
        [&](auto&... channel) {
          return (
              (channel.codec && channel.name == event.channel && (take(event, channel), true)) ||
              ...);
        },
        channels_);
    if (!ours) ++summary_.other_messages;
  }

  template <class Value>
  bool decoded(const LogEvent& event, Channel<Value>& channel, loop::Stamp& stamp) {
    const auto rejection = channel.codec->decode(event.data, stamp, channel.scratch);
    // Another run may have another number of joints: look at the run even where the size is wrong.
    const bool stamped = event.data.size() >= bus::stamp_end;
    const std::int64_t run = stamped ? bus::stamp_of(event.data).run : this->run();
    const bool participant = std::is_same_v<Value, loop::Participant> && run == 0;
    if (run != this->run() && !participant) {
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

  template <class Value>
  void take(const LogEvent& event, Channel<Value>& channel) {
    loop::Stamp stamp;
    if (!decoded(event, channel, stamp)) return;
    if constexpr (in_tick<Value>) {
      take(event, stamp, channel.scratch);
    } else if constexpr (std::is_same_v<Value, loop::Participant>) {
      note_fault(stamp, channel.scratch);
    }
  }

  template <class Value>
  void take(const LogEvent& event, const loop::Stamp& stamp, const Value& value) {
    // The reference answers one tick ahead, so that one may lie just past the end of the run.
    const bool past_end =
        std::is_same_v<Value, loop::ReferencePoint> && stamp.tick == info().num_ticks;
    if (stamp.tick < 0 || stamp.tick > info().num_ticks ||
        (stamp.tick == info().num_ticks && !past_end) || !time_agrees(stamp)) {
      ++summary_.wrong_tick;
      return;
    }
    if (past_end) return;
    if (stamp.tick < base_) {
      ++summary_.too_late;
      return;
    }
    if (stamp.tick >= base_ + num_held) {
      keep_ahead(event, stamp.tick);
      return;
    }
    newest_ = std::max(newest_, stamp.tick);
    release_below_ = std::max(release_below_, newest_ - window);
    TickRecord& record = slot_of(stamp.tick);
    if (const Value* old = loop::find<Value>(record)) {
      auto& summary = piece_summary(loop::slot_of<Value>());
      ++(loop::same(*old, value) ? summary.duplicates : summary.conflicts);
      return;
    }
    record.tick = stamp.tick;
    loop::entry_of<Value>(record) = value;
  }

  /// In lockstep, time is the tick's: a number that was damaged gives itself away.
  [[nodiscard]] bool time_agrees(const loop::Stamp& stamp) const {
    if (scenario().loop.mode != experiment::Mode::lockstep) return true;
    const double t_us = static_cast<double>(stamp.tick) * info().period_s * 1e6;
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

  void note_fault(const loop::Stamp& stamp, const loop::Participant& who) {
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
    for (const Slot piece : loop::all_slots) {
      if (!has(record, piece)) continue;
      ++piece_summary(piece).count;
      count_missing(piece, record.tick);
      last_seen_[index(piece)] = record.tick;
    }
  }

  /// Ticks from the one after the last that had `piece` to the one before `tick`.
  void count_missing(Slot piece, std::int64_t tick) {
    const TickRange range{last_seen_[index(piece)] + 1, tick - 1};
    if (range.first > range.last) return;
    auto& summary = piece_summary(piece);
    summary.missing += static_cast<std::uint64_t>(range.last - range.first + 1);
    if (summary.missing_list.size() < RunSummary::max_listed) summary.missing_list.push_back(range);
  }

  void finish() {
    if (std::exchange(finished_, true)) return;
    for (const Slot piece : loop::all_slots) count_missing(piece, summary_.last_tick + 1);
  }

  struct Ahead {
    LogEvent event;
    std::int64_t tick;
  };

  LogReader reader_;
  std::function<void(const LogEvent&)> on_event_;
  RunDescription described_;
  RunSummary summary_;

  Channels channels_;
  std::array<std::string, loop::num_slots> piece_channels_;

  std::vector<TickRecord> slots_;
  std::int64_t base_ = 0;           // ticks below it are handed out or will not come
  std::int64_t release_below_ = 0;  // ticks below it are to be handed out
  std::int64_t newest_ = -1;        // highest tick in a slot
  std::deque<Ahead> ahead_;
  std::deque<LogEvent> ready_;
  bool at_end_ = false;  // the file has been read to its end
  bool finished_ = false;
  std::array<std::int64_t, loop::num_slots> last_seen_{};
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
void RunLog::watch(std::function<void(const LogEvent&)> on_event) {
  impl_->watch(std::move(on_event));
}
void RunLog::rewind() { impl_->rewind(); }
const RunSummary& RunLog::summary() const { return impl_->summary(); }
const Damage& RunLog::damage() const { return impl_->reader().damage(); }

}  // namespace tachless::logger

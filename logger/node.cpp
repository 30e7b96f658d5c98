#include "logger/node.h"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/logging.h"
#include "bus/key.h"
#include "logger/log_file.h"
#include "logger/tick_messages.h"
#include "logger/tick_tally.h"
#include "messages/wire.h"
#include "session/log_window.h"
#include "session/responders.h"
#include "session/run_info.h"

namespace tachless::logger {
namespace {

using namespace std::chrono_literals;
using base::Clock;
using messages::Slot;
using session::Receipt;

// In realtime the log is closed after this many consecutive waits without a message. Waits are
// counted, not time, so that a stalled machine is not taken for silence. After the plant's last
// message others may still be on their way.
constexpr auto silent_wait = 10ms;
constexpr int silence = 5;
// A plant that fails brings the robot to rest first, which is recorded too.
constexpr int silence_of_a_failing_plant = 15;
constexpr auto longest_conclusion = 1500ms;

/// The role that publishes the messages of a slot.
messages::Role role_of(Slot slot) {
  switch (slot) {
    case Slot::reference:
      return messages::Role::reference;
    case Slot::command:
    case Slot::controller_state:
      return messages::Role::controller;
    default:
      return messages::Role::plant;
  }
}

/// Base of the recorders of both modes: joins, checks every message of the run before it
/// goes on, writes RUN_INFO before the first of them, closes the log in every case. The log of a
/// run that has failed ends with the announcement of the fault that ended it: a member's, or this
/// process's own. Does not know which message is due.
class Recorder {
 public:
  Recorder(const scenario::Scenario& scenario, session::Session& session,
           const std::filesystem::path& log_path)
      : scenario_(scenario),
        session_(session),
        file_(log_path),
        ack_port_(messages::port<messages::LogAck>(scenario.robot.channel_prefix, {})),
        info_channel_(messages::channel<messages::RunInfo>(scenario.robot.channel_prefix)) {
    session_.on_announcement([this](const bus::Datagram& datagram) {
      read_fault(datagram);
      on_participant(datagram);
    });
    session_.statistics().logger().log.path = log_path.string();
    base::log_detail("writes the log {}", log_path.string());
  }
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;
  virtual ~Recorder() = default;

  void run() {
    try {
      session_.join({}, {});
      // Before this process confirms the roster, so before the first message of a tick.
      law_ = session_.membership().law();
      messages_.emplace(scenario_, law_);
      on_joined();
      for (const Slot slot : messages::all_slots) {
        // An unknown measurement is refused by the plant.
        if (!messages_->channel(slot).empty()) record(slot);
      }
      session_.run_until_finished([this](Clock::time_point now) { return is_complete(now); },
                                  [this](Clock::time_point now) {
                                    file_.flush_if_due(now);
                                    repeat_info(now);
                                    // A flush is due soon after what is in the buffer now.
                                    return now + LogWriter::flush_interval / 2;
                                  });
      conclude(true);
      file_.sync([this](const auto& done) { session_.attend_until(done); });
      whole_ = true;
      session_.leave();
    } catch (const std::exception&) {
      save_the_rest(base::current_failure());
      throw;
    }
    file_.close();
  }

 protected:
  /// The messages of the run are known.
  virtual void on_joined() {}
  virtual void on_message(Slot slot, const messages::Stamp& stamp,
                          const bus::Datagram& datagram) = 0;
  /// A participant's announcement.
  virtual void on_participant(const bus::Datagram& /*datagram*/) {}
  /// A member has announced a fault: the run ends.
  virtual void on_stop(std::int64_t /*tick*/) {}
  /// A message has been handled: writes and acknowledges what is due.
  virtual void after_message() = 0;
  /// Returns whether every tick has come, or is never to come.
  [[nodiscard]] virtual bool is_complete(Clock::time_point now) const = 0;
  /// The plant has finished, or (not `well`) the run has failed: records what still comes.
  virtual void conclude(bool well) = 0;
  /// The time of an event that belongs to no tick.
  [[nodiscard]] virtual std::int64_t utime() const = 0;

  /// Counts as Session::count does. Once the run has failed, a conflict is recorded and throws
  /// nothing.
  void count(Receipt receipt, messages::Role from, const bus::Datagram& datagram,
             std::int64_t tick) {
    if (concluding_) return session_.count(receipt);
    session_.count(receipt, from, datagram, tick);
  }
  void append(std::int64_t utime, std::string_view channel, std::span<const std::byte> data) {
    file_.append(utime, channel, data);
    ++session_.statistics().logger().log.events;
  }
  void acknowledge(std::int64_t tick, std::uint64_t missing) {
    session_.publish(ack_port_, {0, session_.run(), tick}, messages::LogAck{missing});
  }

  const scenario::Scenario& scenario_;
  session::Session& session_;
  std::optional<TickChannels> messages_;  ///< from `on_joined` on
  LogWriter file_;
  bool introduced_ = false;  ///< the log has RUN_INFO
  bool concluding_ = false;  ///< the run has failed

 private:
  void record(Slot slot) {
    session_.on(messages_->channel(slot), [this, slot](const bus::Datagram& datagram) {
      messages::Stamp stamp;
      const messages::Rejection rejection = messages_->check(slot, datagram.payload, stamp);
      if (!session_.accept(rejection, stamp)) return;
      introduce();
      on_message(slot, stamp, datagram);
      after_message();
    });
  }

  /// Before the first message of the run.
  void introduce() {
    if (std::exchange(introduced_, true)) return;
    session_.note_started(Clock::now());
    info_ = session::run_info(scenario_, session_.run(), law_);
    append(0, info_channel_, info_);
  }

  /// Once a second on the bus, for programs that begin to watch a run that goes on.
  void repeat_info(Clock::time_point now) {
    if (info_.empty() || now < next_info_) return;
    next_info_ = now + 1s;
    session_.publish(info_channel_, info_);
  }

  /// Looks for a fault in a member's announcement. The first one after which this process has to
  /// end is the cause.
  void read_fault(const bus::Datagram& announcement) {
    messages::Stamp stamp;
    if (participant_codec_.decode(announcement.payload, stamp, announced_) !=
            messages::Rejection::none ||
        announced_.fault.empty() || stamp.run != session_.run()) {
      return;
    }
    on_stop(stamp.tick);
    if (!concluding_ && fault_.empty() && session_.membership().failure() &&
        announced_.state == messages::ParticipantState::fault) {
      fault_.assign(announcement.payload.begin(), announcement.payload.end());
    }
  }

  /// Records the messages that have arrived already. In realtime it also records how the robot is
  /// brought to rest; the plant has to know of the failure for that.
  void save_the_rest(const base::Failure& cause) {
    try {
      const auto own = session_.announce_end(cause);
      if (fault_.empty()) fault_.assign(own.begin(), own.end());
      if (!whole_) {
        concluding_ = true;
        conclude(false);
      }
      if (introduced_) append(utime(), session_.channel(), fault_);
    } catch (const base::Failure&) {
      // The first failure is the one to tell.
    }
    try {
      file_.close();
    } catch (const base::Failure& failure) {
      if (std::string_view(failure.what()) != cause.what()) {
        base::log_warning(failure.what());
      }
    }
  }

  messages::Port<messages::LogAck> ack_port_;
  std::string info_channel_;
  std::vector<std::byte> info_;    ///< RUN_INFO; empty until it is in the log
  Clock::time_point next_info_{};  ///< when it is published next
  messages::Codec<messages::Participant> participant_codec_{messages::Layout{}};
  messages::Participant announced_;  ///< the last announcement
  messages::LawInfo law_;            ///< the controller's
  bool whole_ = false;               ///< every tick is on the disk
  std::vector<std::byte> fault_;  ///< announcement of the member's fault that has ended it, if any
};

/// Records tick by tick, each complete and once, stamped with simulation time; acknowledges, and
/// has what it misses repeated. Announcements are not recorded, but for the fault that ends the log
/// of a run that has failed.
class LockstepRecorder final : public Recorder {
 public:
  LockstepRecorder(const scenario::Scenario& scenario, session::Session& session,
                   const std::filesystem::path& log_path)
      : Recorder(scenario, session, log_path) {}

 private:
  void on_joined() override { window_.emplace(scenario_.loop.num_ticks, messages_->longest()); }
  void on_message(Slot slot, const messages::Stamp& stamp, const bus::Datagram& datagram) override {
    const Receipt receipt = window_->on_message(slot, stamp.tick, datagram.payload);
    count(receipt, role_of(slot), datagram, stamp.tick);
  }
  void after_message() override {
    write_complete_ticks();
    if (const auto ack = window_->take_ack()) acknowledge(ack->tick, ack->missing);
  }
  [[nodiscard]] bool is_complete(Clock::time_point /*now*/) const override {
    return window_->is_all_written();
  }
  void conclude(bool well) override {
    if (well) return compare_truth();  // every tick is written
    constexpr int most = 10'000;  // a flood of datagrams must not keep this process from its end
    for (int i = 0; i < most && session_.receive(Clock::time_point()); ++i) {
    }
  }
  [[nodiscard]] std::int64_t utime() const override { return utime_; }

  void write_complete_ticks() {
    while (const auto tick = window_->complete_tick()) {
      const auto begin = Clock::now();
      utime_ = messages::stamp_of(window_->bytes(*tick, Slot::tick)).utime;
      for (const Slot slot : messages::all_slots) {
        if (messages_->channel(slot).empty()) continue;
        append(utime_, messages_->channel(slot), window_->bytes(*tick, slot));
      }
      truth_digest_.add(window_->bytes(*tick, Slot::truth));
      window_->on_written();
      session_.note_progress(*tick);
      session_.statistics().ticks = *tick + 1;
      session_.statistics().logger().log.ticks = *tick + 1;
      session_.statistics().work_us.add(Clock::now() - begin);
    }
  }

  /// A forged TRUTH contradicts the plant's own, and is noticed by that, unless that one is lost.
  void compare_truth() {
    if (session_.membership().truth_digest() == truth_digest_.value()) return;
    throw base::Failure(
        base::ExitCode::protocol_violated,
        "the messages recorded on {} are not those that {} has published: another process has "
        "published there too; find it with tachless watch, or use a key (--key-file)",
        messages_->channel(Slot::truth), session_.describe(messages::Role::plant));
  }

  std::optional<session::LogWindow> window_;
  bus::Digest truth_digest_;  ///< of what is written
  std::int64_t utime_ = 0;    ///< of the last tick written
};

/// Records in order of arrival, each message once, PARTICIPANT included, stamped with the time of
/// arrival since the first tick. Nothing is repeated for it; what never came is counted at the end,
/// by channel and tick.
class RealtimeRecorder final : public Recorder {
 public:
  RealtimeRecorder(const scenario::Scenario& scenario, session::Session& session,
                   const std::filesystem::path& log_path)
      : Recorder(scenario, session, log_path),
        num_ticks_(scenario.loop.num_ticks),
        pace_(scenario.loop.period_s),
        tally_(scenario.loop.num_ticks, has_slot(scenario, Slot::contact)) {}

 private:
  void on_message(Slot slot, const messages::Stamp& stamp, const bus::Datagram& datagram) override {
    const auto begin = Clock::now();
    const std::int64_t ahead = slot == Slot::reference && stamp.tick > 0 ? 1 : 0;
    if (!pace_.possible(stamp.tick - ahead, begin) &&
        !session_.membership().knows(datagram.sender)) {
      return session_.count(Receipt::not_asked);
    }
    const Receipt receipt = tally_.on_message(slot, stamp.tick, datagram.payload);
    silent_waits_ = 0;
    if (receipt == Receipt::conflicting && !concluding_) {
      append(since_start(begin), datagram.channel, datagram.payload);
    }
    if (receipt != Receipt::fresh) {
      return count(receipt, role_of(slot), datagram, stamp.tick);
    }
    if (!start_) start_ = begin - std::chrono::microseconds(stamp.utime);
    append(since_start(begin), datagram.channel, datagram.payload);
    if (slot == Slot::truth && messages_->is_stopped()) tally_.on_stop(stamp.tick);
    session::Statistics& statistics = session_.statistics();
    session_.note_progress(tally_.newest());
    statistics.ticks = tally_.newest() + 1;
    statistics.work_us.add(Clock::now() - begin);
  }
  void on_participant(const bus::Datagram& datagram) override {
    // RUN_INFO comes first, so that a log begins with what explains it.
    if (introduced_) append(utime(), datagram.channel, datagram.payload);
  }
  void on_stop(std::int64_t tick) override { tally_.stop_after(tick); }
  void after_message() override {}
  [[nodiscard]] bool is_complete(Clock::time_point now) const override {
    return pace_.over(tally_.newest(), num_ticks_ - 1, now);
  }
  void conclude(bool well) override {
    if (!well) tally_.stop_after(tally_.newest());
    if (start_) {
      const auto until = Clock::now() + longest_conclusion;
      const int patience = well ? silence : silence_of_a_failing_plant;
      silent_waits_ = 0;
      while (silent_waits_ < patience && Clock::now() < until) {
        if (!well) session_.announce_if_due(Clock::now());
        if (!session_.receive(std::min(until, Clock::now() + silent_wait))) ++silent_waits_;
        file_.flush_if_due(Clock::now());
      }
    }
    tally_.finish(well ? num_ticks_ - 1 : tally_.newest());
    session_.statistics().logger().log.ticks = tally_.num_complete();
    session_.statistics().logger().log.gaps = tally_.num_incomplete();
    for (const Slot slot : messages::all_slots) {
      const auto& missing = tally_.missing(slot);
      if (missing.count == 0) continue;
      base::log_warning("{} of {} ticks have no {}: {}", missing.count,
                        tally_.num_complete() + tally_.num_incomplete(), messages_->channel(slot),
                        missing.text());
    }
  }
  [[nodiscard]] std::int64_t utime() const override { return since_start(Clock::now()); }

  [[nodiscard]] std::int64_t since_start(Clock::time_point now) const {
    return start_ && now > *start_ ? (now - *start_) / 1us : 0;
  }

  std::int64_t num_ticks_;
  session::Pace pace_;
  TickTally tally_;
  std::optional<Clock::time_point> start_;  ///< of tick 0, as seen from here
  int silent_waits_ = 0;                    ///< of the conclusion, since the last message of a tick
};

}  // namespace

void run_node(const scenario::Scenario& scenario, session::Session& session,
              const std::filesystem::path& log_path) {
  if (scenario.loop.mode == scenario::Mode::realtime) {
    RealtimeRecorder(scenario, session, log_path).run();
  } else {
    LockstepRecorder(scenario, session, log_path).run();
  }
}

}  // namespace tachless::logger

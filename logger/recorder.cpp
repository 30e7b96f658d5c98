#include "logger/recorder.h"

#include <fmt/core.h>

#include <algorithm>

#include "diagnostics/logging.h"

namespace tachless::logger {

using loop::Clock;
using protocol::lockstep::Verdict;

Recorder::Recorder(const experiment::Scenario& scenario, bus::Transport& transport,
                   node::Link& link, const std::filesystem::path& log_path)
    : transport_(transport),
      link_(link),
      loop_(transport, link),
      messages_(scenario),
      ack_channel_(loop::channel<loop::LogAck>(scenario.robot.channel_prefix)),
      run_info_codec_(loop::Layout{}),
      ack_codec_(loop::Layout{}),
      participant_codec_(loop::Layout{}),
      file_(log_path) {
  loop_.on_session([this](const bus::Datagram& datagram) {
    keep_fault(datagram);
    on_participant(datagram);
  });
  loop_.on(loop::channel<loop::RunInfo>(scenario.robot.channel_prefix),
           [this](const bus::Datagram& datagram) {
             on_run_info(datagram);
             after_message();
           });
  for (int slot = 0; slot < loop::num_slots; ++slot) {
    if (!messages_.channel(static_cast<Slot>(slot)).empty()) record(static_cast<Slot>(slot));
  }
  link_.statistics().logger().log.path = log_path.string();
  diagnostics::log_detail("writes the log {}", log_path.string());
}

void Recorder::record(Slot slot) {
  loop_.on(messages_.channel(slot), [this, slot](const bus::Datagram& datagram) {
    on_slot(slot, datagram);
    after_message();
  });
}

void Recorder::run() {
  try {
    link_.join({}, {});
    loop_.run_until_finished([this](Clock::time_point now) { return complete(now); },
                             [this](Clock::time_point now) {
                               file_.flush_if_due(now);
                               // A flush is due soon after what is in the buffer now.
                               return now + LogWriter::flush_interval / 2;
                             });
    conclude(true);
    file_.sync();
    whole_ = true;
    link_.leave();
  } catch (const diagnostics::Failure& failure) {
    save_the_rest(failure);
    throw;
  }
  file_.close();
}

void Recorder::on_slot(Slot slot, const bus::Datagram& datagram) {
  loop::Stamp stamp;
  const bus::Rejection rejection = messages_.check(slot, datagram.payload, stamp);
  if (link_.accept(rejection, stamp)) on_message(slot, stamp, datagram);
}

void Recorder::on_run_info(const bus::Datagram& datagram) {
  loop::Stamp stamp;
  loop::RunInfo info;
  node::Statistics& statistics = link_.statistics();
  if (!link_.accept(run_info_codec_, datagram, stamp, info)) return;
  if (stamp.tick != -1) return statistics.rejected.add(node::Discard::not_asked);
  const bool first = run_info_.empty();
  if (first && !messages_.select_measurement(info.measurement)) {
    return statistics.rejected.add(bus::Rejection::bad_value);
  }
  const bool same = std::ranges::equal(run_info_, datagram.payload);
  const Verdict verdict = take_run_info(first || same);
  if (verdict == Verdict::conflicting) {
    count(verdict, loop::Role::plant, datagram, stamp.tick, [this] { return run_info_sender_; });
  }
  if (!first) {
    ++statistics.duplicates;
    return;
  }
  run_info_.assign(datagram.payload.begin(), datagram.payload.end());
  run_info_sender_ = datagram.sender;
  // Before the acknowledgement, and so before the first measurement.
  record(Slot::measurement);
  link_.started(Clock::now());
  append(stamp.utime, datagram.channel, run_info_);
}

void Recorder::append(std::int64_t utime, std::string_view channel,
                      std::span<const std::byte> data) {
  file_.append(utime, channel, data);
  ++link_.statistics().logger().log.events;
}

void Recorder::acknowledge(std::int64_t tick, std::uint64_t missing) {
  transport_.publish(ack_channel_,
                     ack_codec_.encode({0, link_.run(), tick}, loop::LogAck{missing}));
}

loop::Role Recorder::role_of(Slot slot) {
  switch (slot) {
    case Slot::reference:
      return loop::Role::reference;
    case Slot::command:
    case Slot::controller_state:
      return loop::Role::controller;
    default:
      return loop::Role::plant;
  }
}

/// The first announcement of a fault after which this process has to end is the cause.
void Recorder::keep_fault(const bus::Datagram& announcement) {
  if (concluding_ || !fault_.empty() || !link_.membership().failure()) return;
  loop::Stamp stamp;
  loop::Participant who;
  if (participant_codec_.decode(announcement.payload, stamp, who) == bus::Rejection::none &&
      who.state == loop::ParticipantState::fault) {
    fault_.assign(announcement.payload.begin(), announcement.payload.end());
  }
}

/// What has arrived already still belongs into the log, and in realtime how the robot is brought to
/// rest, for which the plant has to know.
void Recorder::save_the_rest(const diagnostics::Failure& cause) {
  try {
    record_end(cause);
  } catch (const diagnostics::Failure&) {
    // The first failure is the one to tell.
  }
  try {
    file_.close();
  } catch (const diagnostics::Failure& failure) {
    if (std::string_view(failure.what()) != cause.what()) diagnostics::log_warning(failure.what());
  }
}

void Recorder::record_end(const diagnostics::Failure& cause) {
  const auto own = link_.ending(cause);
  if (fault_.empty()) fault_.assign(own.begin(), own.end());
  if (!whole_) {
    concluding_ = true;
    conclude(false);
  }
  if (!run_info_.empty()) append(utime(), link_.channel(), fault_);
}

}  // namespace tachless::logger

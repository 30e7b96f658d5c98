#include "logger/recorder.h"

#include <algorithm>

#include "diagnostics/logging.h"

namespace tachless::logger {

using loop::Clock;
using protocol::lockstep::Verdict;

Recorder::Recorder(const experiment::Scenario& scenario, bus::Transport& transport,
                   node::Session& session, const std::filesystem::path& log_path)
    : transport_(transport),
      session_(session),
      messages_(scenario),
      run_info_channel_(loop::channel<loop::RunInfo>(scenario.robot.channel_prefix)),
      ack_channel_(loop::channel<loop::LogAck>(scenario.robot.channel_prefix)),
      run_info_codec_(loop::Layout{}),
      ack_codec_(loop::Layout{}),
      file_(log_path) {
  transport_.subscribe(run_info_channel_);
  for (const std::string& each : messages_.channels()) {
    if (!each.empty()) transport_.subscribe(each);
  }
  session_.statistics().log = node::Statistics::Log{log_path.string(), 0, 0, 0};
}

void Recorder::run() {
  try {
    session_.meet();
    while (!session_.plant_finished()) {
      const auto now = Clock::now();
      session_.attend(now);
      file_.flush_if_due(now);
      // A flush is due soon after what is in the buffer now.
      receive(std::min(session_.next_attention(), now + LogWriter::flush_interval / 2));
    }
  } catch (const diagnostics::Failure& failure) {
    save_the_rest(failure);
    throw;
  }
  conclude(true);
  file_.close();
  session_.finish();
}

bool Recorder::receive(Clock::time_point deadline) {
  const auto datagram = transport_.receive(deadline);
  if (datagram) take(*datagram);
  return datagram.has_value();
}

void Recorder::take(const bus::Datagram& datagram) {
  if (session_.take(datagram)) return on_participant(datagram);
  if (datagram.channel == run_info_channel_) {
    hear_run_info(datagram);
  } else {
    const auto found = std::ranges::find(messages_.channels(), datagram.channel);
    if (found == messages_.channels().end()) return;
    const auto slot = static_cast<Slot>(found - messages_.channels().begin());
    loop::Stamp stamp;
    node::Statistics& statistics = session_.statistics();
    const bus::Rejection rejection = messages_.check(slot, datagram.payload, stamp);
    if (rejection != bus::Rejection::none) return statistics.rejected.add(rejection);
    if (stamp.run != session_.run()) return statistics.rejected.add(node::Discard::other_run);
    on_message(slot, stamp, datagram);
  }
  after_message();
}

void Recorder::hear_run_info(const bus::Datagram& datagram) {
  loop::Stamp stamp;
  loop::RunInfo info;
  node::Statistics& statistics = session_.statistics();
  if (!session_.accept(run_info_codec_, datagram, stamp, info)) return;
  if (stamp.tick != -1) return statistics.rejected.add(node::Discard::not_asked);
  const bool first = run_info_.empty();
  if (first && !messages_.select_measurement(info.measurement)) {
    return statistics.rejected.add(bus::Rejection::bad_value);
  }
  const bool same = std::ranges::equal(run_info_, datagram.payload);
  if (on_run_info(first || same) == Verdict::conflicting) {
    throw diagnostics::Failure(diagnostics::ExitCode::protocol_violated,
                               "two plants drive run " + std::to_string(stamp.run) + ": " +
                                   run_info_sender_ + " and " + std::string(datagram.sender) +
                                   " describe it differently; end one of them");
  }
  if (!first) {
    ++statistics.duplicates;
    return;
  }
  run_info_.assign(datagram.payload.begin(), datagram.payload.end());
  run_info_sender_ = datagram.sender;
  // Before the acknowledgement, and so before the first measurement.
  transport_.subscribe(messages_.channel(Slot::measurement));
  session_.started(Clock::now());
  append(stamp.utime, run_info_channel_, run_info_);
}

void Recorder::append(std::int64_t utime, std::string_view channel,
                      std::span<const std::byte> data) {
  file_.append(utime, channel, data);
  ++session_.statistics().log->events;
}

void Recorder::acknowledge(std::int64_t tick, std::uint64_t missing) {
  transport_.publish(ack_channel_,
                     ack_codec_.encode({0, session_.run(), tick}, loop::LogAck{missing}));
}

void Recorder::count(Verdict verdict, Slot slot, std::int64_t tick, std::string_view first,
                     std::string_view second) {
  node::Statistics& statistics = session_.statistics();
  switch (verdict) {
    case Verdict::fresh:
      return;
    case Verdict::repeated:
      ++statistics.duplicates;
      return;
    case Verdict::not_asked:
      return statistics.rejected.add(node::Discard::not_asked);
    case Verdict::too_old:
      return statistics.rejected.add(node::Discard::too_old);
    case Verdict::conflicting:
      throw diagnostics::Failure(diagnostics::ExitCode::protocol_violated,
                                 "two processes play one role in run " +
                                     std::to_string(session_.run()) + ": " + std::string(first) +
                                     " and " + std::string(second) + " sent different " +
                                     messages_.channel(slot) + " messages for tick " +
                                     std::to_string(tick) + "; end one of them");
  }
}

void Recorder::save_the_rest(const diagnostics::Failure& cause) {
  try {
    conclude(false);
  } catch (const diagnostics::Failure&) {
    // The first failure is the one to tell.
  }
  try {
    file_.close();
  } catch (const diagnostics::Failure& failure) {
    if (std::string_view(failure.what()) != cause.what()) diagnostics::log_warning(failure.what());
  }
}

}  // namespace tachless::logger

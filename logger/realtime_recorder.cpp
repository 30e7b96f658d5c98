#include "logger/realtime_recorder.h"

#include <fmt/core.h>

#include <algorithm>
#include <chrono>
#include <utility>

#include "diagnostics/logging.h"

namespace tachless::logger {
namespace {

using namespace std::chrono_literals;

// What has to pass without a message, in waits of their own: a machine that stands still makes one
// of them longer, and is no silence. After the plant's last message others may still be on their
// way.
constexpr auto silent_wait = 10ms;
constexpr int silence = 5;
// A plant that fails brings the robot to rest first, which is recorded too.
constexpr int silence_of_a_failing_plant = 15;
constexpr auto longest_conclusion = 1500ms;

}  // namespace

using loop::Clock;
using protocol::lockstep::Verdict;

RealtimeRecorder::RealtimeRecorder(const experiment::Scenario& scenario, bus::Transport& transport,
                                   node::Link& link, const std::filesystem::path& log_path)
    : Recorder(scenario, transport, link, log_path),
      num_ticks_(scenario.loop.num_ticks),
      pace_(scenario.loop.period_s),
      tally_(scenario.loop.num_ticks) {}

Verdict RealtimeRecorder::take_run_info(bool same) {
  if (!same) return Verdict::conflicting;
  introduced_ = true;
  acknowledgement_due_ = true;
  return Verdict::fresh;
}

std::int64_t RealtimeRecorder::since_start(Clock::time_point now) const {
  return start_ && now > *start_ ? (now - *start_) / 1us : 0;
}

void RealtimeRecorder::on_message(Slot slot, const loop::Stamp& stamp,
                                  const bus::Datagram& datagram) {
  const auto begin = Clock::now();
  const std::int64_t ahead = slot == Slot::reference && stamp.tick > 0 ? 1 : 0;
  if (!introduced_ ||
      (!pace_.possible(stamp.tick - ahead, begin) && !link().knows(datagram.sender))) {
    return loop().count(Verdict::not_asked);
  }
  const Verdict verdict = tally_.on_message(slot, stamp.tick, datagram.payload);
  silent_waits_ = 0;
  if (verdict == Verdict::conflicting && !concluding()) {
    append(since_start(begin), datagram.channel, datagram.payload);
  }
  if (verdict != Verdict::fresh) {
    return count(verdict, role_of(slot), datagram, stamp.tick, [] { return "an earlier sender"; });
  }
  if (!start_) start_ = begin - std::chrono::microseconds(stamp.utime);
  append(since_start(begin), datagram.channel, datagram.payload);
  node::Statistics& statistics = link().statistics();
  link().progressed(tally_.newest());
  statistics.ticks = tally_.newest() + 1;
  statistics.work_us.add(Clock::now() - begin);
}

void RealtimeRecorder::after_message() {
  // Not before the measurement is subscribed to: the plant starts at once.
  if (std::exchange(acknowledgement_due_, false)) acknowledge(-1, 0);
}

void RealtimeRecorder::on_participant(const bus::Datagram& datagram) {
  // RUN_INFO comes first, so that a log begins with what explains it.
  if (introduced_) append(since_start(Clock::now()), datagram.channel, datagram.payload);
}

bool RealtimeRecorder::complete(Clock::time_point now) const {
  return pace_.over(tally_.newest(), num_ticks_ - 1, now);
}

void RealtimeRecorder::conclude(bool well) {
  if (start_) {
    const auto until = Clock::now() + longest_conclusion;
    const int patience = well ? silence : silence_of_a_failing_plant;
    silent_waits_ = 0;
    while (silent_waits_ < patience && Clock::now() < until) {
      if (!well) link().announce_if_due(Clock::now());
      if (!loop().receive(std::min(until, Clock::now() + silent_wait))) ++silent_waits_;
      file().flush_if_due(Clock::now());
    }
  }
  tally_.finish(well ? num_ticks_ - 1 : tally_.newest());
  link().statistics().logger().log.ticks = tally_.complete();
  link().statistics().logger().log.gaps = tally_.incomplete();
  tell_what_is_missing();
}

void RealtimeRecorder::tell_what_is_missing() {
  for (int i = 0; i < loop::num_slots; ++i) {
    const auto slot = static_cast<Slot>(i);
    const auto& missing = tally_.missing(slot);
    if (missing.count == 0) continue;
    diagnostics::log_warning("{} of {} ticks have no {}: {}", missing.count,
                             tally_.complete() + tally_.incomplete(), messages().channel(slot),
                             text_of(missing));
  }
}

}  // namespace tachless::logger

#include "plant/realtime_loop.h"

#include <algorithm>
#include <chrono>
#include <exception>
#include <string>

#include "diagnostics/format.h"

namespace tachless::plant {
namespace {

using namespace std::chrono_literals;
using loop::Clock;
using loop::truth::DriveFault;
using protocol::lockstep::Verdict;

constexpr auto introduction_period = 20ms;
// From the logger's word that it is ready to the first tick.
constexpr auto lead_in = 5ms;
// Whoever floods the bus must not keep the plant from its next tick.
constexpr int most_at_once = 64;

std::chrono::nanoseconds nanoseconds(double seconds) {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
      std::chrono::duration<double>(seconds));
}

}  // namespace

RealtimeLoop::RealtimeLoop(const experiment::Scenario& scenario, bus::Transport& transport,
                           node::Session& session, RobotDriver* driver)
    : scenario_(scenario),
      transport_(transport),
      session_(session),
      robot_(scenario, session, driver),
      watch_(scenario.loop.max_missed, robot_.longest_command()) {
  transport_.subscribe(robot_.command_channel());
  transport_.subscribe(robot_.ack_channel());
}

Clock::time_point RealtimeLoop::deadline(std::int64_t tick) const {
  return start_ + nanoseconds(static_cast<double>(tick) * scenario_.loop.period_s);
}

Clock::time_point RealtimeLoop::end_of_tick() const {
  // Caught up with in no time, late ticks would all miss their commands.
  return std::max(deadline(tick_ + 1), tick_began_ + nanoseconds(scenario_.loop.period_s / 2));
}

void RealtimeLoop::run() {
  session_.meet({}, {}, [this](const bus::Datagram& datagram) { refuse_early(datagram); });
  robot_.prepare();
  introduce();
  try {
    robot_.start();
    start();
    keep_time();
  } catch (const diagnostics::Failure& failure) {
    come_to_rest(failure);
    throw;
  } catch (const std::exception& problem) {
    come_to_rest(diagnostics::Failure(diagnostics::ExitCode::protocol_violated, problem.what()));
    throw;
  }
  robot_.stop();
  session_.finish();
}

void RealtimeLoop::refuse_early(const bus::Datagram& datagram) {
  if (datagram.channel != robot_.command_channel() || !robot_.is_command(datagram.payload)) return;
  throw diagnostics::Failure(diagnostics::ExitCode::protocol_violated,
                             "a command came on " + robot_.command_channel() +
                                 " before the start, from " + std::string(datagram.sender) +
                                 " (run " + std::to_string(bus::stamp_of(datagram.payload).run) +
                                 "): an old controller is still there; end it first");
}

void RealtimeLoop::introduce() {
  const auto begin = Clock::now();
  const auto give_up_at = begin + nanoseconds(scenario_.loop.give_up_s);
  session_.started(begin);
  session_.attend(begin);
  for (auto repeat_at = begin;;) {
    const auto now = Clock::now();
    session_.attend(now);
    if (now >= give_up_at) {
      throw diagnostics::Failure(
          diagnostics::ExitCode::peer_lost,
          session_.describe(loop::Role::logger) +
              " does not acknowledge RUN_INFO; see its output (loop.give_up_s)");
    }
    if (now >= repeat_at) {
      transport_.publish(robot_.run_info_channel(), robot_.run_info());
      if (repeat_at != begin) ++session_.statistics().resends;
      repeat_at = now + introduction_period;
    }
    const auto datagram = transport_.receive(std::min(repeat_at, session_.next_attention()));
    if (!datagram || session_.take(*datagram)) continue;
    refuse_early(*datagram);
    loop::Stamp stamp;
    loop::LogAck ack;
    if (datagram->channel == robot_.ack_channel() && robot_.hear_ack(*datagram, stamp, ack)) return;
  }
}

void RealtimeLoop::start() {
  start_ = Clock::now() + lead_in;
  commanded_at_ = start_;
  while (Clock::now() < start_) {
    const auto datagram = transport_.receive(start_);
    if (datagram && !session_.take(*datagram)) refuse_early(*datagram);
  }
}

void RealtimeLoop::keep_time() {
  for (tick_ = 0; tick_ < scenario_.loop.num_ticks; ++tick_) {
    begin_tick();
    receive_until(end_of_tick());
    end_tick();
  }
}

void RealtimeLoop::note_wake_up(Clock::time_point now) {
  const auto late = now - deadline(tick_);
  node::Statistics& statistics = session_.statistics();
  statistics.wake_up_jitter.add(late);
  if (watch_.missed_in_a_row() == 0) longest_delay_ = 0ns;
  longest_delay_ = std::max<std::chrono::nanoseconds>(longest_delay_, late);
  if (late > nanoseconds(scenario_.loop.period_s)) {
    ++statistics.missed_deadlines;
    statistics.longest_miss = std::max(statistics.longest_miss, ++late_in_a_row_);
  } else {
    late_in_a_row_ = 0;
  }
}

void RealtimeLoop::require_recent_torque(Clock::time_point now) const {
  // A real robot does not wait for a process that stands still. Missed commands alone end the run
  // before this.
  const auto held_for = now - commanded_at_;
  if (held_for <= nanoseconds(scenario_.loop.period_s * (scenario_.loop.max_missed + 2))) return;
  throw protective_stop(
      diagnostics::format(
          "the robot's torque has been held for %.1f ms, longer than loop.max_missed (%d) "
          "allows: ",
          std::chrono::duration<double, std::milli>(held_for).count(), scenario_.loop.max_missed) +
      (watch_.missed_in_a_row() > 0 ? what_is_missing() + ", and " : "") +
      "this process, or the driver's read, did not get on; start a new run on a machine that is "
      "quiet (tachless doctor), with a read that does not wait");
}

void RealtimeLoop::begin_tick() {
  tick_began_ = Clock::now();
  note_wake_up(tick_began_);
  publish_question(tick_began_);
  if (scenario_.loop.command_delay == 1) {
    act(held_ ? DriveFault::command_missed : DriveFault::none);
  }
}

void RealtimeLoop::publish_question(Clock::time_point now) {
  begun_ = true;
  watch_.begin(tick_);
  const auto measurement = robot_.measurement(tick_);
  asked_ = Clock::now();
  transport_.publish(robot_.measurement_channel(), measurement);
  loop::Stamp stamp = robot_.stamp(tick_);
  stamp.utime = (now - start_) / 1us;
  transport_.publish(robot_.tick_channel(), robot_.tick(stamp));
}

void RealtimeLoop::act(DriveFault fault) {
  transport_.publish(robot_.truth_channel(), robot_.truth(tick_, fault));
  acted_ = true;
  const auto now = Clock::now();
  if (fault != DriveFault::protective_stop && !robot_.emulated()) require_recent_torque(now);
  if (fault == DriveFault::none) commanded_at_ = now;
  robot_.advance(tick_);
}

void RealtimeLoop::receive_until(Clock::time_point deadline) {
  session_.attend(Clock::now());
  while (Clock::now() < deadline) {
    const auto datagram = transport_.receive(std::min(deadline, session_.next_attention()));
    if (datagram) take(*datagram);
    const auto now = Clock::now();
    if (now < deadline) session_.attend(now);
  }
  // What was there in time and is not read yet counts.
  for (int i = 0; i < most_at_once; ++i) {
    const auto datagram = transport_.receive(Clock::time_point());
    if (!datagram) break;
    take(*datagram);
  }
}

void RealtimeLoop::take(const bus::Datagram& datagram) {
  if (session_.take(datagram)) return;
  if (datagram.channel == robot_.command_channel()) on_command(datagram);
}

void RealtimeLoop::on_command(const bus::Datagram& datagram) {
  loop::Stamp stamp;
  if (!robot_.hear_command(datagram, stamp)) return;
  node::Statistics& statistics = session_.statistics();
  switch (watch_.on_command(stamp.tick, datagram.payload, datagram.sender)) {
    case Verdict::fresh:
      statistics.command_age.add(Clock::now() - asked_);
      robot_.drive();
      if (scenario_.loop.command_delay == 0) act(DriveFault::none);
      return;
    case Verdict::repeated:
      ++statistics.duplicates;
      return;
    case Verdict::too_old:
      ++statistics.late_commands;
      return;
    case Verdict::not_asked:
      return statistics.rejected.add(node::Discard::not_asked);
    case Verdict::conflicting:
      throw robot_.two_commanders(stamp.tick, watch_.sender_of(stamp.tick), datagram.sender);
  }
}

void RealtimeLoop::end_tick() {
  watch_.end();
  held_ = !watch_.commanded();
  if (!acted_) act(DriveFault::command_missed);
  robot_.end_tick();
  begun_ = false;
  acted_ = false;

  node::Statistics& statistics = session_.statistics();
  statistics.missed_commands = watch_.missed();
  statistics.longest_command_miss = watch_.longest_miss();
  statistics.ticks = tick_ + 1;
  session_.progressed(tick_);
  if (watch_.too_many()) {
    throw protective_stop(what_is_missing() + ", more than loop.max_missed (" +
                          std::to_string(scenario_.loop.max_missed) + ")" + what_to_mend());
  }
}

diagnostics::Failure RealtimeLoop::protective_stop(const std::string& why) const {
  return {diagnostics::ExitCode::protective_stop,
          "protective stop at tick " + std::to_string(tick_) + ": " + why};
}

std::string RealtimeLoop::what_is_missing() const {
  return std::to_string(watch_.missed_in_a_row()) +
         " commands in a row did not come in time from " +
         session_.silent_among({loop::Role::controller, loop::Role::reference});
}

std::string RealtimeLoop::what_to_mend() const {
  if (longest_delay_ <= nanoseconds(scenario_.loop.period_s)) {
    return "; mend that and start a new run";
  }
  // Then it need not be the others who are to blame.
  return diagnostics::format(
      ". The plant itself woke up to %.1f ms late: this machine stood still or is too busy "
      "(tachless doctor); start a new run on a quieter one",
      std::chrono::duration<double, std::milli>(longest_delay_).count());
}

void RealtimeLoop::come_to_rest(const diagnostics::Failure& failure) {
  session_.stopping(failure, Clock::now());
  try {
    robot_.stop();
    if (tick_ < 0) return;  // it has not begun
    if (begun_ && !acted_) act(DriveFault::protective_stop);
    const auto most = static_cast<std::int64_t>(
        std::chrono::duration<double>(longest_stop).count() / scenario_.loop.period_s);
    const std::int64_t end = std::min(scenario_.loop.num_ticks, tick_ + 1 + most);
    for (++tick_; tick_ < end; ++tick_) {
      while (Clock::now() < deadline(tick_)) {
        if (const auto datagram = transport_.receive(deadline(tick_))) session_.take(*datagram);
        session_.keep_in_touch(Clock::now());
      }
      session_.keep_in_touch(Clock::now());  // behind time too
      publish_question(Clock::now());
      act(DriveFault::protective_stop);
      session_.progressed(tick_);
      session_.statistics().ticks = tick_ + 1;
      if (robot_.at_rest()) break;
    }
  } catch (const std::exception&) {
    // The simulation cannot go on: the failure that was first is the one to tell.
  }
}

}  // namespace tachless::plant

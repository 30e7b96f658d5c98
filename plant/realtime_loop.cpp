#include "plant/realtime_loop.h"

#include <fmt/core.h>

#include <algorithm>
#include <chrono>
#include <exception>
#include <string>

#include "bus/wire.h"
#include "diagnostics/text.h"
#include "diagnostics/time.h"

namespace tachless::plant {
namespace {

using namespace std::chrono_literals;
using diagnostics::ExitCode;
using diagnostics::Failure;
using diagnostics::nanoseconds_of;
using loop::Clock;
using loop::Role;
using loop::truth::DriveFault;
using protocol::lockstep::Verdict;

constexpr auto introduction_period = 20ms;
// From the logger's acknowledgement to the first tick.
constexpr auto lead_in = 5ms;
// A flood of datagrams must not delay the next tick.
constexpr int most_at_once = 64;

double milliseconds(std::chrono::nanoseconds duration) {
  return std::chrono::duration<double, std::milli>(duration).count();
}

}  // namespace

RealtimeLoop::RealtimeLoop(const experiment::Scenario& scenario, bus::Transport& transport,
                           node::Link& link, RobotDriver* driver)
    : scenario_(scenario),
      transport_(transport),
      link_(link),
      loop_(transport, link),
      robot_(scenario, driver),
      messages_(scenario, robot_, link),
      commands_(scenario.loop.max_missed, messages_.command_port().longest) {
  loop_.on(messages_.command_port().channel, [this](const auto& each) { on_command(each); });
  transport_.subscribe(messages_.ack_port().channel);  // heard before the first tick only
}

Clock::time_point RealtimeLoop::deadline(std::int64_t tick) const {
  return start_ + nanoseconds_of(static_cast<double>(tick) * scenario_.loop.period_s);
}

Clock::time_point RealtimeLoop::end_of_tick() const {
  // Caught up with in no time, late ticks would all miss their commands.
  return std::max(deadline(tick_ + 1), tick_began_ + nanoseconds_of(scenario_.loop.period_s / 2));
}

void RealtimeLoop::run() {
  link_.join({}, [this](const bus::Datagram& datagram) { refuse_early(datagram); });
  messages_.prepare();
  introduce();
  try {
    robot_.start();
    start();
    keep_time();
  } catch (const Failure& failure) {
    come_to_rest(failure);
    throw;
  } catch (const std::exception& problem) {
    come_to_rest(Failure(ExitCode::protocol_violated, problem.what()));
    throw;
  }
  robot_.stop();
  link_.leave();
  judge_deadlines();
}

/// The run is whole and stays so; whether it was one in real time is another question.
void RealtimeLoop::judge_deadlines() {
  const auto missed = link_.statistics().plant().missed_deadlines;
  const double share = static_cast<double>(missed) / static_cast<double>(scenario_.loop.num_ticks);
  if (share <= scenario_.loop.max_missed_share) return;
  link_.statistics().exit_code = ExitCode::check_said_no;
  link_.statistics().fault = fmt::format(
      "{} of {} deadlines were missed ({:.3g} %), more than loop.max_missed_share ({}) allows: "
      "this machine is too slow, too busy or without real-time rights for ticks of {:.6g} ms; "
      "type: tachless doctor; or lengthen loop.period_s",
      missed, scenario_.loop.num_ticks, 100 * share,
      diagnostics::shortest(scenario_.loop.max_missed_share), 1e3 * scenario_.loop.period_s);
}

void RealtimeLoop::refuse_early(const bus::Datagram& datagram) {
  if (datagram.channel != messages_.command_port().channel ||
      !messages_.is_command(datagram.payload))
    return;
  throw Failure(ExitCode::protocol_violated,
                "a command came on {} before the start, from {} (run {}): an old controller is "
                "still there; end it first",
                datagram.channel, datagram.sender, bus::stamp_of(datagram.payload).run);
}

void RealtimeLoop::introduce() {
  const auto begin = Clock::now();
  const auto give_up_at = begin + nanoseconds_of(scenario_.loop.give_up_s);
  link_.started(begin);
  link_.poll(begin);
  for (auto repeat_at = begin;;) {
    const auto now = Clock::now();
    link_.poll(now);
    if (now >= give_up_at) {
      throw Failure(ExitCode::peer_lost,
                    "{} does not acknowledge RUN_INFO; see its output (loop.give_up_s)",
                    link_.describe(Role::logger));
    }
    if (now >= repeat_at) {
      transport_.publish(messages_.run_info_port().channel, messages_.run_info());
      if (repeat_at != begin) ++link_.statistics().resends;
      repeat_at = now + introduction_period;
    }
    const auto datagram = transport_.receive(std::min(repeat_at, link_.next_poll()));
    if (!datagram || link_.handle(*datagram)) continue;
    refuse_early(*datagram);
    loop::Stamp stamp;
    loop::LogAck ack;
    if (datagram->channel == messages_.ack_port().channel &&
        messages_.accept_ack(*datagram, stamp, ack))
      return;
  }
}

void RealtimeLoop::start() {
  start_ = Clock::now() + lead_in;
  commanded_at_ = start_;
  while (Clock::now() < start_) {
    const auto datagram = transport_.receive(start_);
    if (datagram && !link_.handle(*datagram)) refuse_early(*datagram);
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
  node::PlantStatistics& statistics = link_.statistics().plant();
  statistics.wake_up_jitter_us.add(late);
  if (commands_.missed_in_a_row() == 0) longest_delay_ = 0ns;
  longest_delay_ = std::max<std::chrono::nanoseconds>(longest_delay_, late);
  if (late > nanoseconds_of(scenario_.loop.period_s)) {
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
  if (held_for <= nanoseconds_of(scenario_.loop.period_s * (scenario_.loop.max_missed + 2))) return;
  throw protective_stop(fmt::format(
      "the robot's torque has been held for {:.1f} ms, longer than loop.max_missed ({}) allows: "
      "{}this process, or the driver's read, did not get on; start a new run on a machine that is "
      "quiet (tachless doctor), with a read that does not wait",
      milliseconds(held_for), scenario_.loop.max_missed,
      commands_.missed_in_a_row() > 0 ? what_is_missing() + ", and " : ""));
}

void RealtimeLoop::begin_tick() {
  tick_began_ = Clock::now();
  note_wake_up(tick_began_);
  publish_question(tick_began_);
  if (scenario_.loop.command_delay > 0) {
    act(held_ ? DriveFault::command_missed : DriveFault::none);
  }
}

void RealtimeLoop::publish_question(Clock::time_point now) {
  begun_ = true;
  commands_.begin(tick_);
  robot_.read(tick_);
  const auto measurement = messages_.measurement(tick_);
  asked_ = Clock::now();
  transport_.publish(messages_.measurement_port().channel, measurement);
  loop::Stamp stamp = messages_.stamp(tick_);
  stamp.utime = (now - start_) / 1us;
  transport_.publish(messages_.tick_port().channel, messages_.tick(stamp));
}

void RealtimeLoop::act(DriveFault fault) {
  transport_.publish(messages_.truth_port().channel, messages_.truth(tick_, fault));
  acted_ = true;
  const auto now = Clock::now();
  if (fault != DriveFault::protective_stop && !robot_.emulated()) require_recent_torque(now);
  if (fault == DriveFault::none) commanded_at_ = now;
  link_.statistics().work_us.add(robot_.advance(tick_));
}

void RealtimeLoop::receive_until(Clock::time_point deadline) {
  link_.poll(Clock::now());
  while (Clock::now() < deadline) {
    loop_.receive(std::min(deadline, link_.next_poll()));
    const auto now = Clock::now();
    if (now < deadline) link_.poll(now);
  }
  // What was there in time and is not read yet counts.
  for (int i = 0; i < most_at_once && loop_.receive(Clock::time_point()); ++i) {
  }
}

void RealtimeLoop::on_command(const bus::Datagram& datagram) {
  loop::Stamp stamp;
  if (!messages_.accept_command(datagram, stamp)) return;
  node::PlantStatistics& statistics = link_.statistics().plant();
  const Verdict verdict = commands_.on_command(stamp.tick, datagram.payload, datagram.sender);
  if (verdict == Verdict::too_old) {
    ++statistics.late_commands;
    return;
  }
  loop_.count(verdict, Role::controller, datagram, stamp.tick,
              [&] { return commands_.sender_of(stamp.tick); });
  if (verdict != Verdict::fresh) return;
  statistics.command_age_us.add(Clock::now() - asked_);
  robot_.accept(messages_.command());
  if (scenario_.loop.command_delay == 0) act(DriveFault::none);
}

void RealtimeLoop::end_tick() {
  commands_.end();
  held_ = !commands_.commanded();
  if (!acted_) act(DriveFault::command_missed);
  robot_.end_tick();
  begun_ = false;
  acted_ = false;

  node::PlantStatistics& statistics = link_.statistics().plant();
  statistics.missed_commands = commands_.missed();
  statistics.longest_command_miss = commands_.longest_miss();
  link_.statistics().ticks = tick_ + 1;
  link_.progressed(tick_);
  if (commands_.too_many()) {
    throw protective_stop(fmt::format("{}, more than loop.max_missed ({}){}", what_is_missing(),
                                      scenario_.loop.max_missed, what_to_mend()));
  }
}

Failure RealtimeLoop::protective_stop(const std::string& why) const {
  return {ExitCode::protective_stop, fmt::format("protective stop at tick {}: {}", tick_, why)};
}

std::string RealtimeLoop::what_is_missing() const {
  return fmt::format("{} commands in a row did not come in time from {}",
                     commands_.missed_in_a_row(),
                     link_.silent_among({Role::controller, Role::reference}));
}

std::string RealtimeLoop::what_to_mend() const {
  if (longest_delay_ <= nanoseconds_of(scenario_.loop.period_s)) {
    return "; mend that and start a new run";
  }
  // Then it need not be the others who are to blame.
  return fmt::format(
      ". The plant itself woke up to {:.1f} ms late: this machine stood still or is too busy "
      "(tachless doctor); start a new run on a quieter one",
      milliseconds(longest_delay_));
}

void RealtimeLoop::come_to_rest(const Failure& failure) {
  link_.stopping(failure, Clock::now());
  try {
    robot_.stop();
    if (tick_ < 0) return;  // it has not begun
    if (begun_ && !acted_) act(DriveFault::protective_stop);
    const auto most = static_cast<std::int64_t>(
        std::chrono::duration<double>(longest_stop).count() / scenario_.loop.period_s);
    const std::int64_t end = std::min(scenario_.loop.num_ticks, tick_ + 1 + most);
    for (++tick_; tick_ < end; ++tick_) {
      while (Clock::now() < deadline(tick_)) {
        if (const auto datagram = transport_.receive(deadline(tick_))) link_.handle(*datagram);
        link_.announce_if_due(Clock::now());
      }
      link_.announce_if_due(Clock::now());  // behind time too
      publish_question(Clock::now());
      act(DriveFault::protective_stop);
      link_.progressed(tick_);
      link_.statistics().ticks = tick_ + 1;
      if (robot_.at_rest()) break;
    }
  } catch (const std::exception&) {
    // The simulation cannot go on: the failure that was first is the one to tell.
  }
}

}  // namespace tachless::plant

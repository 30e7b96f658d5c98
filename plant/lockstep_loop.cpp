#include "plant/lockstep_loop.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <string>

#include "diagnostics/logging.h"

namespace tachless::plant {
namespace {

using loop::Clock;
using protocol::lockstep::MessageRing;
using protocol::lockstep::TickMaster;
using protocol::lockstep::Verdict;

enum Kind : int { tick_kind, measurement_kind, truth_kind };

TickMaster::Config tick_master_config(const experiment::Scenario& scenario) {
  TickMaster::Config config;
  config.num_ticks = scenario.loop.num_ticks;
  config.give_up = std::chrono::duration_cast<std::chrono::nanoseconds>(
      std::chrono::duration<double>(scenario.loop.give_up_s));
  return config;
}

}  // namespace

LockstepLoop::LockstepLoop(const experiment::Scenario& scenario, bus::Transport& transport,
                           node::Session& session)
    : scenario_(scenario),
      transport_(transport),
      session_(session),
      robot_(scenario, session),
      tick_master_(tick_master_config(scenario), robot_.longest_command()) {
  transport_.subscribe(robot_.command_channel());
  transport_.subscribe(robot_.ack_channel());
}

void LockstepLoop::run() {
  session_.meet();
  robot_.prepare();
  sent_.emplace(
      std::array{robot_.longest_tick(), robot_.longest_measurement(), robot_.longest_truth()});
  introduce();
  while (!tick_master_.finished()) {
    const auto now = Clock::now();
    session_.attend(now);
    help_successor(now);
    repeat(now);
    if (tick_master_.may_begin()) begin_tick();
    give_up_if_lost(now);
    receive(std::min(tick_master_.deadline(), session_.next_attention()));
  }
  session_.finish();
}

void LockstepLoop::introduce() {
  const auto now = Clock::now();
  session_.started(now);
  session_.attend(now);
  transport_.publish(robot_.run_info_channel(), robot_.run_info());
  tick_master_.introduced(now);
}

/// A controller that has died may be succeeded by one that rebuilds its memory and has to hear
/// again what the log does not hold yet.
void LockstepLoop::help_successor(Clock::time_point now) {
  node::Statistics& statistics = session_.statistics();
  if (session_.takeovers() > statistics.takeovers) {
    statistics.takeovers = session_.takeovers();
    tick_master_.replaced(now);
    diagnostics::log_warning(
        session_.describe(loop::Role::controller) +
        " has taken the place of one that is silent, before the command for tick " +
        std::to_string(tick_master_.next_tick()));
  }
  if (tick_master_.catching_up()) {
    tick_master_.successor_at(session_.tick_of(loop::Role::controller), now);
  }
}

void LockstepLoop::begin_tick() {
  const std::int64_t k = tick_master_.next_tick();
  const auto measurement = robot_.measurement(k);
  tick_master_.asked(Clock::now());
  // First: the command waits for it.
  transport_.publish(robot_.measurement_channel(), measurement);
  sent_->put(k, measurement_kind, measurement);
  const auto tick = robot_.tick(robot_.stamp(k));
  transport_.publish(robot_.tick_channel(), tick);
  sent_->put(k, tick_kind, tick);
}

void LockstepLoop::receive(Clock::time_point deadline) {
  const auto datagram = transport_.receive(deadline);
  if (!datagram || session_.take(*datagram)) return;
  if (datagram->channel == robot_.command_channel()) {
    on_command(*datagram);
  } else if (datagram->channel == robot_.ack_channel()) {
    on_ack(*datagram);
  }
}

void LockstepLoop::on_command(const bus::Datagram& datagram) {
  loop::Stamp stamp;
  if (!robot_.hear_command(datagram, stamp)) return;
  node::Statistics& statistics = session_.statistics();
  switch (tick_master_.on_command(stamp.tick, datagram.payload, datagram.sender, Clock::now())) {
    case Verdict::fresh:
      statistics.round_trip.add(tick_master_.round_trip());
      return end_tick();
    case Verdict::repeated:
      ++statistics.duplicates;
      return;
    case Verdict::not_asked:
      return statistics.rejected.add(node::Discard::not_asked);
    case Verdict::too_old:
      return statistics.rejected.add(node::Discard::too_old);
    case Verdict::conflicting:
      throw robot_.two_commanders(stamp.tick, tick_master_.sender_of(stamp.tick), datagram.sender);
  }
}

void LockstepLoop::on_ack(const bus::Datagram& datagram) {
  loop::Stamp stamp;
  loop::LogAck ack;
  if (!robot_.hear_ack(datagram, stamp, ack)) return;
  node::Statistics& statistics = session_.statistics();
  const Verdict verdict = tick_master_.on_ack(stamp.tick, ack.missing, Clock::now());
  if (verdict == Verdict::not_asked) statistics.rejected.add(node::Discard::not_asked);
  if (verdict == Verdict::too_old) statistics.rejected.add(node::Discard::too_old);
}

void LockstepLoop::end_tick() {
  const std::int64_t k = tick_master_.next_tick();
  robot_.drive();
  const auto truth = robot_.truth(k, loop::truth::DriveFault::none);
  transport_.publish(robot_.truth_channel(), truth);
  sent_->put(k, truth_kind, truth);
  robot_.advance(k);
  robot_.end_tick();
  tick_master_.completed(Clock::now());
  session_.progressed(k);
  session_.statistics().ticks = k + 1;
}

void LockstepLoop::repeat(Clock::time_point now) {
  node::Statistics& statistics = session_.statistics();
  while (const auto repeat = tick_master_.next_repeat(now)) {
    if (repeat->what == TickMaster::Repeat::What::run_info) {
      transport_.publish(robot_.run_info_channel(), robot_.run_info());
      ++statistics.resends;
      continue;
    }
    const std::int64_t k = repeat->tick;
    transport_.publish(robot_.tick_channel(), sent_->bytes(k, tick_kind));
    transport_.publish(robot_.measurement_channel(), sent_->bytes(k, measurement_kind));
    statistics.resends += 2;
    if (repeat->what == TickMaster::Repeat::What::all) {
      transport_.publish(robot_.truth_channel(), sent_->bytes(k, truth_kind));
      ++statistics.resends;
    }
  }
}

void LockstepLoop::give_up_if_lost(Clock::time_point now) const {
  using loop::Role;
  if (!tick_master_.given_up(now)) return;
  std::string who;
  std::string what;
  switch (tick_master_.waiting()) {
    case TickMaster::Waiting::nobody:
      return;
    case TickMaster::Waiting::command:
      who = session_.silent_among({Role::controller, Role::reference});
      what = "no command for tick " + std::to_string(tick_master_.next_tick());
      break;
    case TickMaster::Waiting::logger_for_run_info:
      who = session_.describe(Role::logger);
      what = "RUN_INFO is not acknowledged";
      break;
    case TickMaster::Waiting::logger_for_window:
    case TickMaster::Waiting::logger_for_end:
      who = tick_master_.logger_heard()
                ? session_.silent_among({Role::controller, Role::reference, Role::logger})
                : session_.describe(Role::logger);
      what = "tick " + std::to_string(tick_master_.acknowledged() + 1) + " is not recorded";
      break;
  }
  std::array<char, 32> duration{};
  std::snprintf(duration.data(), duration.size(), "%.3g s", scenario_.loop.give_up_s);
  throw diagnostics::Failure(
      diagnostics::ExitCode::peer_lost,
      what + " for " + duration.data() + ": lost is " + who + "; see its output (loop.give_up_s)");
}

}  // namespace tachless::plant

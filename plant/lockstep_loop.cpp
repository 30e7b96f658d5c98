#include "plant/lockstep_loop.h"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <string>

#include "diagnostics/logging.h"
#include "diagnostics/time.h"

namespace tachless::plant {
namespace {

using loop::Clock;
using loop::Role;
using protocol::lockstep::TickMaster;
using protocol::lockstep::Verdict;

enum Kind : int { tick_kind, measurement_kind, truth_kind };

TickMaster::Config tick_master_config(const experiment::Scenario& scenario) {
  TickMaster::Config config;
  config.num_ticks = scenario.loop.num_ticks;
  config.give_up = diagnostics::nanoseconds_of(scenario.loop.give_up_s);
  return config;
}

}  // namespace

LockstepLoop::LockstepLoop(const experiment::Scenario& scenario, bus::Transport& transport,
                           node::Link& link)
    : scenario_(scenario),
      transport_(transport),
      link_(link),
      loop_(transport, link),
      robot_(scenario),
      messages_(scenario, robot_, link),
      tick_master_(tick_master_config(scenario), messages_.command_port().longest) {
  loop_.on(messages_.command_port().channel, [this](const auto& each) { on_command(each); });
  loop_.on(messages_.ack_port().channel, [this](const auto& each) { on_ack(each); });
}

void LockstepLoop::run() {
  link_.join({}, {});
  messages_.prepare();
  sent_.emplace(std::array{messages_.tick_port().longest, messages_.measurement_port().longest,
                           messages_.truth_port().longest});
  introduce();
  loop_.run_until([this] { return tick_master_.finished(); },
                  [this](Time now) {
                    help_successor(now);
                    repeat(now);
                    if (tick_master_.may_begin()) begin_tick();
                    give_up_if_lost(now);
                    return tick_master_.deadline();
                  });
  link_.membership().published(truth_digest_.value());
  link_.leave();
}

void LockstepLoop::introduce() {
  const auto now = Clock::now();
  link_.started(now);
  link_.poll(now);
  transport_.publish(messages_.run_info_port().channel, messages_.run_info());
  tick_master_.introduced(now);
}

/// Another controller may take over from one that has died. It rebuilds the law's memory and is
/// asked again what the log does not hold yet.
void LockstepLoop::help_successor(Time now) {
  std::int64_t& takeovers = link_.statistics().plant().takeovers;
  if (link_.membership().takeovers() > takeovers) {
    takeovers = link_.membership().takeovers();
    tick_master_.replaced(now);
    diagnostics::log_warning(
        "{} has taken the place of one that is silent, before the command for tick {}",
        link_.describe(Role::controller), tick_master_.next_tick());
  }
  if (tick_master_.catching_up()) tick_master_.successor_at(link_.tick_of(Role::controller), now);
}

void LockstepLoop::begin_tick() {
  const std::int64_t k = tick_master_.next_tick();
  robot_.read(k);
  const auto measurement = messages_.measurement(k);
  tick_master_.asked(Clock::now());
  // First: the command waits for it.
  transport_.publish(messages_.measurement_port().channel, measurement);
  sent_->put(k, measurement_kind, measurement);
  const auto tick = messages_.tick(messages_.stamp(k));
  transport_.publish(messages_.tick_port().channel, tick);
  sent_->put(k, tick_kind, tick);
}

void LockstepLoop::on_command(const bus::Datagram& datagram) {
  loop::Stamp stamp;
  if (!messages_.accept_command(datagram, stamp)) return;
  const Verdict verdict =
      tick_master_.on_command(stamp.tick, datagram.payload, datagram.sender, Clock::now());
  loop_.count(verdict, Role::controller, datagram, stamp.tick,
              [&] { return tick_master_.sender_of(stamp.tick); });
  if (verdict != Verdict::fresh) return;
  link_.statistics().plant().round_trip_us.add(tick_master_.round_trip());
  end_tick();
}

void LockstepLoop::on_ack(const bus::Datagram& datagram) {
  loop::Stamp stamp;
  loop::LogAck ack;
  if (!messages_.accept_ack(datagram, stamp, ack)) return;
  loop_.count(tick_master_.on_ack(stamp.tick, ack.missing, Clock::now()));
}

void LockstepLoop::end_tick() {
  const std::int64_t k = tick_master_.next_tick();
  robot_.accept(messages_.command());
  const auto truth = messages_.truth(k, loop::truth::DriveFault::none);
  transport_.publish(messages_.truth_port().channel, truth);
  sent_->put(k, truth_kind, truth);
  truth_digest_.add(truth);
  link_.statistics().work_us.add(robot_.advance(k));
  robot_.end_tick();
  tick_master_.completed(Clock::now());
  link_.progressed(k);
  link_.statistics().ticks = k + 1;
}

void LockstepLoop::repeat(Time now) {
  std::int64_t& resends = link_.statistics().resends;
  while (const auto repeat = tick_master_.next_repeat(now)) {
    if (repeat->what == TickMaster::Repeat::What::run_info) {
      transport_.publish(messages_.run_info_port().channel, messages_.run_info());
      ++resends;
      continue;
    }
    const std::int64_t k = repeat->tick;
    transport_.publish(messages_.tick_port().channel, sent_->bytes(k, tick_kind));
    transport_.publish(messages_.measurement_port().channel, sent_->bytes(k, measurement_kind));
    resends += 2;
    if (repeat->what == TickMaster::Repeat::What::all) {
      transport_.publish(messages_.truth_port().channel, sent_->bytes(k, truth_kind));
      ++resends;
    }
  }
}

void LockstepLoop::give_up_if_lost(Time now) const {
  if (!tick_master_.given_up(now)) return;
  std::string who;
  std::string what;
  switch (tick_master_.waiting()) {
    case TickMaster::Waiting::nobody:
      return;
    case TickMaster::Waiting::command:
      who = link_.silent_among({Role::controller, Role::reference});
      what = fmt::format("no command for tick {}", tick_master_.next_tick());
      break;
    case TickMaster::Waiting::logger_for_run_info:
      who = link_.describe(Role::logger);
      what = "RUN_INFO is not acknowledged";
      break;
    case TickMaster::Waiting::logger_for_window:
    case TickMaster::Waiting::logger_for_end:
      who = tick_master_.logger_heard()
                ? link_.silent_among({Role::controller, Role::reference, Role::logger})
                : link_.describe(Role::logger);
      what = fmt::format("tick {} is not recorded", tick_master_.acknowledged() + 1);
      break;
  }
  throw diagnostics::Failure(diagnostics::ExitCode::peer_lost,
                             "{} for {:.3g} s: lost is {}; see its output (loop.give_up_s)", what,
                             scenario_.loop.give_up_s, who);
}

}  // namespace tachless::plant

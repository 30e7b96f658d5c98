#include <fmt/core.h>

#include <array>
#include <optional>
#include <string>

#include "bus/key.h"
#include "diagnostics/logging.h"
#include "diagnostics/time.h"
#include "plant/plant_loop.h"
#include "protocol/lockstep/message_ring.h"
#include "protocol/lockstep/tick_master.h"

namespace tachless::plant {
namespace {

using loop::Clock;
using loop::Role;
using protocol::lockstep::TickMaster;
using protocol::lockstep::Verdict;
using Repeated = TickMaster::Repeat::What;

enum Kind : int { tick_kind, measurement_kind, truth_kind };

TickMaster::Config tick_master_config(const experiment::Scenario& scenario) {
  TickMaster::Config config;
  config.num_ticks = scenario.loop.num_ticks;
  config.give_up = diagnostics::nanoseconds_of(scenario.loop.give_up_s);
  return config;
}

class LockstepLoop : PlantLoop {
 public:
  LockstepLoop(const experiment::Scenario& scenario, node::Link& link)
      : PlantLoop(scenario, link),
        tick_master_(tick_master_config(scenario), command_port_.codec.longest()) {
    link_.on(command_port_.channel, [this](const auto& each) { on_command(each); });
    link_.on(ack_port_.channel, [this](const auto& each) { on_ack(each); });
  }

  void run() {
    link_.join({}, {});
    prepare();
    sent_.emplace(std::array{tick_port_.codec.longest(), measurement_port_->codec.longest(),
                             truth_port_.codec.longest()});
    introduce();
    link_.run_until([this] { return tick_master_.finished(); },
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

 private:
  void introduce() {
    const auto now = Clock::now();
    link_.started(now);
    link_.poll(now);
    publish_run_info();
    tick_master_.introduced(now);
  }

  /// Another controller may take over from one that has died. It rebuilds the law's memory and is
  /// asked again what the log does not hold yet.
  void help_successor(Time now) {
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

  void begin_tick() {
    const std::int64_t k = tick_master_.next_tick();
    const Question question = publish_question(stamp(k));
    tick_master_.asked(question.asked);
    sent_->put(k, measurement_kind, question.measurement);
    sent_->put(k, tick_kind, question.tick);
  }

  void on_command(const bus::Datagram& datagram) {
    loop::Stamp stamp;
    if (!accept_command(datagram, stamp)) return;
    const Verdict verdict =
        tick_master_.on_command(stamp.tick, datagram.payload, datagram.sender, Clock::now());
    link_.count(verdict, Role::controller, datagram, stamp.tick,
                [&] { return tick_master_.sender_of(stamp.tick); });
    if (verdict != Verdict::fresh) return;
    link_.statistics().plant().round_trip_us.add(tick_master_.round_trip());
    end_tick();
  }

  void on_ack(const bus::Datagram& datagram) {
    loop::Stamp stamp;
    loop::LogAck ack;
    if (!accept_ack(datagram, stamp, ack)) return;
    link_.count(tick_master_.on_ack(stamp.tick, ack.missing, Clock::now()));
  }

  void end_tick() {
    const std::int64_t k = tick_master_.next_tick();
    robot_.accept(command_);
    const Bytes truth = publish_truth(k, loop::truth::DriveFault::none);
    sent_->put(k, truth_kind, truth);
    truth_digest_.add(truth);
    link_.statistics().work_us.add(robot_.advance(k));
    robot_.end_tick();
    tick_master_.completed(Clock::now());
    completed(k);
  }

  void repeat(Time now) {
    std::int64_t& resends = link_.statistics().resends;
    while (const auto repeat = tick_master_.next_repeat(now)) {
      if (repeat->what == Repeated::run_info) {
        publish_run_info();
        ++resends;
        continue;
      }
      const std::int64_t k = repeat->tick;
      link_.transport().publish(tick_port_.channel, sent_->bytes(k, tick_kind));
      link_.transport().publish(measurement_port_->channel, sent_->bytes(k, measurement_kind));
      resends += 2;
      if (repeat->what == Repeated::all) {
        link_.transport().publish(truth_port_.channel, sent_->bytes(k, truth_kind));
        ++resends;
      }
    }
  }

  void give_up_if_lost(Time now) const {
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

  TickMaster tick_master_;
  bus::Digest truth_digest_;
  std::optional<protocol::lockstep::MessageRing> sent_;  // sized when the measurement is known
};

}  // namespace

void run_lockstep(const experiment::Scenario& scenario, node::Link& link) {
  LockstepLoop(scenario, link).run();
}

}  // namespace tachless::plant

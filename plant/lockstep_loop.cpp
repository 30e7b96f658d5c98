#include <fmt/core.h>

#include <array>
#include <optional>
#include <string>

#include "base/clock.h"
#include "base/logging.h"
#include "bus/key.h"
#include "plant/plant_loop.h"
#include "session/message_ring.h"
#include "session/tick_master.h"

namespace tachless::plant {
namespace {

using base::Clock;
using messages::Role;
using session::TickMaster;
using session::Verdict;
using Repeated = TickMaster::Repeat::What;

enum Kind : int { tick_kind, measurement_kind, truth_kind };

TickMaster::Config tick_master_config(const scenario::Scenario& scenario) {
  TickMaster::Config config;
  config.num_ticks = scenario.loop.num_ticks;
  config.give_up = base::nanoseconds_of(scenario.loop.give_up_s);
  return config;
}

class LockstepLoop : PlantLoop {
 public:
  LockstepLoop(const scenario::Scenario& scenario, session::Link& link)
      : PlantLoop(scenario, link),
        ack_port_(messages::port<messages::LogAck>(prefix_, layout_)),
        tick_master_(tick_master_config(scenario)) {
    link_.on(command_port_.channel, [this](const auto& each) { on_command(each); });
    link_.on(ack_port_.channel, [this](const auto& each) { on_ack(each); });
  }

  void run() {
    link_.join({}, {});
    prepare();
    sent_.emplace(std::array{tick_port_.codec.longest(), measurement_port_->codec.longest(),
                             truth_port_.codec.longest()});
    link_.started(Clock::now());
    link_.run_until([this] { return tick_master_.finished(); },
                    [this](Time now) {
                      repeat(now);
                      if (tick_master_.may_begin()) begin_tick();
                      give_up_if_lost(now);
                      return tick_master_.deadline();
                    });
    link_.membership().published(truth_digest_.value());
    link_.leave();
  }

 private:
  void begin_tick() {
    const std::int64_t k = tick_master_.next_tick();
    const Request request = publish_request(stamp(k));
    tick_master_.asked(request.sent);
    sent_->put(k, measurement_kind, request.measurement);
    sent_->put(k, tick_kind, request.tick);
  }

  void on_command(const bus::Datagram& datagram) {
    messages::Stamp stamp;
    if (!accept_command(datagram, stamp)) return;
    const Verdict verdict = tick_master_.on_command(stamp.tick, datagram.payload, Clock::now());
    link_.count(verdict, Role::controller, datagram, stamp.tick);
    if (verdict != Verdict::fresh) return;
    link_.statistics().plant().round_trip_us.add(tick_master_.round_trip());
    end_tick();
  }

  void on_ack(const bus::Datagram& datagram) {
    messages::Stamp stamp;
    messages::LogAck ack;
    if (!link_.accept(ack_port_.codec, datagram, stamp, ack)) return;
    if (!link_.is_from(Role::logger, datagram.sender)) {
      return link_.statistics().rejected.add(session::Discard::other_sender);
    }
    link_.count(tick_master_.on_ack(stamp.tick, ack.missing, Clock::now()));
  }

  void end_tick() {
    const std::int64_t k = tick_master_.next_tick();
    robot_.accept(command_);
    const Bytes truth = publish_truth(k, messages::truth::DriveFault::none);
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
    std::string missing;
    std::string what;
    switch (tick_master_.waiting()) {
      case TickMaster::Waiting::nothing:
        return;
      case TickMaster::Waiting::command:
        missing = link_.silent_among({Role::controller, Role::reference});
        what = fmt::format("no command for tick {}", tick_master_.next_tick());
        break;
      case TickMaster::Waiting::logger_for_window:
      case TickMaster::Waiting::logger_for_end:
        missing = tick_master_.logger_heard()
                      ? link_.silent_among({Role::controller, Role::reference, Role::logger})
                      : link_.describe(Role::logger);
        what = fmt::format("tick {} is not recorded", tick_master_.acknowledged() + 1);
        break;
    }
    throw base::Failure(base::ExitCode::peer_lost,
                        "{} for {:.3g} s: lost is {}; see its output (loop.give_up_s)", what,
                        scenario_.loop.give_up_s, missing);
  }

  messages::Port<messages::LogAck> ack_port_;
  TickMaster tick_master_;
  bus::Digest truth_digest_;
  std::optional<session::MessageRing> sent_;  // sized when the measurement is known
};

}  // namespace

void run_lockstep(const scenario::Scenario& scenario, session::Link& link) {
  LockstepLoop(scenario, link).run();
}

}  // namespace tachless::plant

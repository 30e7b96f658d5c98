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
using session::Receipt;
using session::TickMaster;
using Repeated = TickMaster::Repeat::What;

enum Kind : int { tick_kind, measurement_kind, truth_kind, contact_kind };

TickMaster::Config tick_master_config(const scenario::Scenario& scenario) {
  TickMaster::Config config;
  config.num_ticks = scenario.loop.num_ticks;
  config.give_up = base::nanoseconds_of(scenario.loop.give_up_s);
  return config;
}

class LockstepLoop : PlantLoop {
 public:
  LockstepLoop(const scenario::Scenario& scenario, session::Session& session, Simulator* simulator)
      : PlantLoop(scenario, session, nullptr, simulator),
        ack_port_(messages::port<messages::LogAck>(prefix_, layout_)),
        tick_master_(tick_master_config(scenario)) {
    session_.on(
        command_port_, [this](const auto&... message) { on_command(message...); },
        [this](auto rejection, const auto& datagram) { require_finite(rejection, datagram); });
    session_.on(ack_port_, [this](const auto&... message) { on_ack(message...); });
  }

  void run() {
    session_.join({}, {});
    prepare();
    sent_.emplace(std::array{tick_port_.codec.longest(), measurement_port_->codec.longest(),
                             truth_port_.codec.longest(),
                             contact_port_ ? contact_port_->codec.longest() : 0});
    session_.note_started(Clock::now());
    session_.run_until([this] { return tick_master_.is_finished(); },
                       [this](Time now) {
                         repeat(now);
                         if (tick_master_.may_begin()) begin_tick();
                         give_up_if_lost(now);
                         return tick_master_.deadline();
                       });
    session_.membership().set_truth_digest(truth_digest_.value());
    session_.leave();
  }

 private:
  void begin_tick() {
    const std::int64_t k = tick_master_.next_tick();
    robot_.read(k);
    const Request request = publish_request(stamp(k));
    tick_master_.on_asked(request.sent);
    sent_->put(k, measurement_kind, request.measurement);
    sent_->put(k, tick_kind, request.tick);
  }

  void on_command(const messages::Stamp& stamp, const messages::TorqueCommand& command,
                  const bus::Datagram& datagram) {
    const Receipt receipt = tick_master_.on_command(stamp.tick, datagram.payload, Clock::now());
    session_.count(receipt, Role::controller, datagram, stamp.tick);
    if (receipt != Receipt::fresh) return;
    session_.statistics().plant().round_trip_us.add(tick_master_.round_trip());
    end_tick(command);
  }

  void on_ack(const messages::Stamp& stamp, const messages::LogAck& ack,
              const bus::Datagram& datagram) {
    if (!session_.is_from(Role::logger, datagram.sender)) {
      return session_.statistics().rejected.add(session::Discard::other_sender);
    }
    session_.count(tick_master_.on_ack(stamp.tick, ack.missing, Clock::now()));
  }

  void end_tick(const messages::TorqueCommand& command) {
    const std::int64_t k = tick_master_.next_tick();
    robot_.accept(command);
    const Truth published = publish_truth(k, messages::truth::DriveFault::none);
    sent_->put(k, truth_kind, published.truth);
    if (contact_port_) sent_->put(k, contact_kind, published.contact);
    truth_digest_.add(published.truth);
    session_.statistics().work_us.add(robot_.advance(k));
    robot_.end_tick();
    tick_master_.on_completed(Clock::now());
    note_completed(k);
  }

  void repeat(Time now) {
    std::int64_t& resends = session_.statistics().resends;
    while (const auto repeat = tick_master_.next_repeat(now)) {
      const std::int64_t k = repeat->tick;
      session_.publish(tick_port_.channel, sent_->bytes(k, tick_kind));
      session_.publish(measurement_port_->channel, sent_->bytes(k, measurement_kind));
      resends += 2;
      if (repeat->what == Repeated::all && contact_port_) {
        session_.publish(contact_port_->channel, sent_->bytes(k, contact_kind));
        ++resends;
      }
      if (repeat->what == Repeated::all) {
        session_.publish(truth_port_.channel, sent_->bytes(k, truth_kind));
        ++resends;
      }
    }
  }

  void give_up_if_lost(Time now) const {
    if (!tick_master_.has_given_up(now)) return;
    std::string missing;
    std::string what;
    switch (tick_master_.waiting()) {
      case TickMaster::Waiting::nothing:
        return;
      case TickMaster::Waiting::command:
        missing = session_.silent_among({Role::controller, Role::reference});
        what = fmt::format("no command for tick {}", tick_master_.next_tick());
        break;
      case TickMaster::Waiting::logger_for_window:
      case TickMaster::Waiting::logger_for_end:
        missing = tick_master_.has_heard_logger()
                      ? session_.silent_among({Role::controller, Role::reference, Role::logger})
                      : session_.describe(Role::logger);
        what = fmt::format("tick {} is not recorded", tick_master_.acknowledged() + 1);
        break;
    }
    throw base::Failure(base::ExitCode::peer_lost,
                        "{} for {:.3g} s: no answer from {}; see its output (loop.give_up_s)", what,
                        scenario_.loop.give_up_s, missing);
  }

  messages::Port<messages::LogAck> ack_port_;
  TickMaster tick_master_;
  bus::Digest truth_digest_;
  std::optional<session::MessageRing> sent_;  // sized when the measurement is known
};

}  // namespace

void run_lockstep(const scenario::Scenario& scenario, session::Session& session,
                  Simulator* simulator) {
  LockstepLoop(scenario, session, simulator).run();
}

}  // namespace tachless::plant

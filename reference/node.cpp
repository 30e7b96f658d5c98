#include "reference/node.h"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "base/logging.h"
#include "messages/wire.h"
#include "reference/make_trajectory.h"
#include "scenario/gains.h"
#include "session/responders.h"

namespace tachless::reference {
namespace {

using base::Clock;
using session::Receipt;

/// Accepts TICK, computes and publishes references.
class Node {
 public:
  Node(const scenario::Scenario& scenario, session::Session& session)
      : session_(session),
        period_s_(scenario.loop.period_s),
        last_tick_(scenario.loop.num_ticks - 1),
        num_joints_(scenario.num_joints),
        scenario_digest_(scenario.digest),
        trajectory_(make_trajectory(scenario)),
        tick_port_(messages::port<messages::Tick>(scenario.robot.channel_prefix,
                                                  messages::layout(scenario.num_joints, false))),
        reference_port_(messages::port<messages::ReferencePoint>(
            scenario.robot.channel_prefix, messages::layout(scenario.num_joints, false))),
        gains_port_(messages::port<messages::GainChange>(scenario.robot.channel_prefix, {})),
        gains_ack_port_(messages::port<messages::GainAck>(scenario.robot.channel_prefix, {})),
        responder_(scenario.loop.num_ticks, reference_port_.codec.longest(),
                   scenario.loop.mode == scenario::Mode::realtime) {
    if (scenario.loop.mode == scenario::Mode::realtime) pace_.emplace(period_s_);
    if (scenario.controller.gains_may_change) {
      session_.on(gains_port_, [this](const messages::Stamp& stamp, messages::GainChange& change,
                                      const bus::Datagram&) { on_gains(stamp, change); });
    }
    session_.on(tick_port_,
                [this](const messages::Stamp& stamp, const messages::Tick&,
                       const bus::Datagram& datagram) { on_tick(stamp.tick, datagram); });
  }
  Node(const Node&) = delete;
  Node& operator=(const Node&) = delete;

  void run() {
    session_.join({}, {});
    session_.run_until_finished([this](Clock::time_point now) {
      const std::int64_t newest = responder_.newest();
      return pace_ ? pace_->over(newest, last_tick_, now) : newest == last_tick_;
    });
    session_.leave();
  }

 private:
  /// Handles a TICK of this run.
  void on_tick(std::int64_t tick, const bus::Datagram& datagram) {
    if (pace_ && !pace_->possible(tick, Clock::now()) &&
        !session_.membership().knows(datagram.sender)) {
      return session_.count(Receipt::not_asked);
    }
    const auto answer = responder_.on_tick(tick, datagram.payload);
    session_.count(answer.receipt, messages::Role::plant, datagram, tick);
    if (answer.receipt != Receipt::fresh && answer.receipt != Receipt::repeated) return;
    session_.note_started(Clock::now());
    for (std::int64_t k = answer.repeat.first; k <= answer.repeat.last; ++k) {
      session_.publish(reference_port_.channel, responder_.kept(k));
      ++session_.statistics().resends;
    }
    for (std::int64_t k = answer.compute.first; k <= answer.compute.last; ++k) {
      responder_.on_computed(k, compute(k));
    }
    session_.note_progress(tick);
    session_.statistics().ticks = responder_.newest() + 1;
  }

  /// Accepts a change of the law's gains and acknowledges it. Its sender must have analysed this
  /// scenario and seen the gains in force. A repeated change is acknowledged again.
  void on_gains(const messages::Stamp& stamp, messages::GainChange& change) {
    if (change.number == acknowledged_ && change.number != 0) return acknowledge();
    if (change.scenario_digest != scenario_digest_ || change.number == 0 ||
        !scenario::read_gains(change.gains, num_joints_)) {
      session_.accept(messages::Rejection::bad_value, stamp);
      return;
    }
    const std::int64_t newest = responder_.newest();
    if (stamp.tick <= changed_at_ || change.replaces != gains_) {
      return session_.count(Receipt::too_old);
    }
    if (newest < 0 || stamp.tick > newest) return session_.count(Receipt::not_asked);
    gains_ = std::move(change.gains);
    changed_at_ = newest + 1;
    acknowledged_ = change.number;
    base::log_info("the law's gains from tick {} on: {}", changed_at_, gains_);
    acknowledge();
  }

  void acknowledge() {
    session_.publish(gains_ack_port_, {0, session_.run(), changed_at_}, {acknowledged_});
  }

  /// Publishes the reference of tick k. The bytes are valid until the next call.
  /// @throw base::Failure(protective_stop) if the reference is not finite.
  std::span<const std::byte> compute(std::int64_t k) {
    const auto begin = Clock::now();
    const double time_s = static_cast<double>(k) * period_s_;
    messages::ReferencePoint reference = trajectory_.at(time_s);
    reference.gains = gains_;
    if (!messages::all_finite(reference)) {
      throw base::Failure(
          base::ExitCode::protective_stop,
          "the reference at t = {:.6f} s (tick {}) is not finite; see reference in the scenario",
          time_s, k);
    }
    const messages::Stamp stamp{std::llround(time_s * 1e6), session_.run(), k};
    const auto bytes = session_.publish(reference_port_, stamp, reference);
    session_.statistics().work_us.add(Clock::now() - begin);
    return bytes;
  }

  session::Session& session_;
  double period_s_;
  std::int64_t last_tick_;
  int num_joints_;
  std::int64_t scenario_digest_;
  Trajectory trajectory_;
  messages::Port<messages::Tick> tick_port_;
  messages::Port<messages::ReferencePoint> reference_port_;
  messages::Port<messages::GainChange> gains_port_;
  messages::Port<messages::GainAck> gains_ack_port_;
  std::int64_t acknowledged_ = 0;  ///< number of the last change; 0: none
  std::string gains_;              ///< gains changed in this run; empty: the scenario's
  std::int64_t changed_at_ = -1;   ///< tick of the first reference with `gains_`
  session::ReferenceResponder responder_;
  std::optional<session::Pace> pace_;  ///< only in realtime
};

}  // namespace

void run_node(const scenario::Scenario& scenario, session::Session& session) {
  Node(scenario, session).run();
}

}  // namespace tachless::reference

#include "reference/node.h"

#include <fmt/core.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "bus/wire.h"
#include "node/session.h"
#include "protocol/lockstep/responders.h"
#include "protocol/realtime/realtime.h"
#include "reference/make_trajectory.h"

namespace tachless::reference {
namespace {

using loop::Clock;
using protocol::lockstep::Verdict;

/// What both modes share: accepts TICK, computes and publishes references.
class Node {
 public:
  Node(const Node&) = delete;
  Node& operator=(const Node&) = delete;
  virtual ~Node() = default;

  void run() {
    link_.join({}, {});
    loop_.run_until_finished([this](Clock::time_point now) { return complete(now); });
    link_.leave();
  }

 protected:
  Node(const experiment::Scenario& scenario, bus::Transport& transport, node::Link& link)
      : link_(link),
        loop_(transport, link),
        last_tick_(scenario.loop.num_ticks - 1),
        transport_(transport),
        period_s_(scenario.loop.period_s),
        trajectory_(make_trajectory(scenario)),
        tick_port_(bus::port<loop::Tick>(scenario.robot.channel_prefix,
                                         loop::layout(scenario.num_joints, false))),
        reference_port_(bus::port<loop::ReferencePoint>(scenario.robot.channel_prefix,
                                                        loop::layout(scenario.num_joints, false))) {
    loop_.on(tick_port_.channel, [this](const bus::Datagram& datagram) {
      loop::Stamp stamp;
      loop::Tick tick;
      if (link_.accept(tick_port_.codec, datagram, stamp, tick)) on_tick(stamp.tick, datagram);
    });
  }

  /// A TICK of this run.
  virtual void on_tick(std::int64_t tick, const bus::Datagram& datagram) = 0;
  /// Whether all references have been asked for.
  [[nodiscard]] virtual bool complete(Clock::time_point now) const = 0;

  /// Counts what became of a TICK. @return whether it is to be answered
  template <class Responder>
  bool count(Verdict verdict, const Responder& responder, std::int64_t tick,
             const bus::Datagram& datagram) {
    loop_.count(verdict, loop::Role::plant, datagram, tick,
                [&] { return responder.sender_of(tick); });
    if (verdict != Verdict::fresh && verdict != Verdict::repeated) return false;
    link_.started(Clock::now());
    return true;
  }

  void publish(std::span<const std::byte> reference) {
    transport_.publish(reference_port_.channel, reference);
  }

  /// Publishes the reference of tick k. The bytes are valid until the next call.
  /// @throw diagnostics::Failure(protective_stop) when it is not finite.
  std::span<const std::byte> compute(std::int64_t k) {
    const auto begin = Clock::now();
    const double time_s = static_cast<double>(k) * period_s_;
    const loop::ReferencePoint reference = trajectory_.at(time_s);
    if (!bus::all_finite(reference)) {
      throw diagnostics::Failure(
          diagnostics::ExitCode::protective_stop,
          "the reference at t = {:.6f} s (tick {}) is not finite; see `reference` in the scenario",
          time_s, k);
    }
    const loop::Stamp stamp{std::llround(time_s * 1e6), link_.run(), k};
    const auto bytes = reference_port_.codec.encode(stamp, reference);
    publish(bytes);
    link_.statistics().work_us.add(Clock::now() - begin);
    return bytes;
  }

  void answered(std::int64_t tick, std::int64_t newest) {
    link_.progressed(tick);
    link_.statistics().ticks = newest + 1;
  }

  node::Link& link_;
  node::Loop loop_;
  std::int64_t last_tick_;

 private:
  bus::Transport& transport_;
  double period_s_;
  Trajectory trajectory_;

 protected:
  bus::Port<loop::Tick> tick_port_;
  bus::Port<loop::ReferencePoint> reference_port_;
};

class LockstepNode final : public Node {
 public:
  LockstepNode(const experiment::Scenario& scenario, bus::Transport& transport, node::Link& link)
      : Node(scenario, transport, link),
        responder_(scenario.loop.num_ticks, tick_port_.codec.longest(),
                   reference_port_.codec.longest()) {}

 private:
  void on_tick(std::int64_t tick, const bus::Datagram& datagram) override {
    const auto answer = responder_.on_tick(tick, datagram.payload, datagram.sender);
    if (!count(answer.verdict, responder_, tick, datagram)) return;
    for (std::int64_t k = answer.repeat.first; k <= answer.repeat.last; ++k) {
      publish(responder_.kept(k));
      ++link_.statistics().resends;
    }
    for (std::int64_t k = answer.compute.first; k <= answer.compute.last; ++k) {
      responder_.computed(k, compute(k));
    }
    answered(tick, responder_.newest());
  }

  [[nodiscard]] bool complete(Clock::time_point /*now*/) const override {
    return responder_.newest() == last_tick_;
  }

  protocol::lockstep::ReferenceResponder responder_;
};

class RealtimeNode final : public Node {
 public:
  RealtimeNode(const experiment::Scenario& scenario, bus::Transport& transport, node::Link& link)
      : Node(scenario, transport, link),
        responder_(scenario.loop.num_ticks, tick_port_.codec.longest()),
        pace_(scenario.loop.period_s) {}

 private:
  void on_tick(std::int64_t tick, const bus::Datagram& datagram) override {
    if (!pace_.possible(tick, Clock::now()) && !link_.knows(datagram.sender)) {
      return loop_.count(Verdict::not_asked);
    }
    const auto answer = responder_.on_tick(tick, datagram.payload, datagram.sender);
    if (!count(answer.verdict, responder_, tick, datagram)) return;
    for (std::int64_t k = answer.first; k <= answer.last; ++k) compute(k);
    answered(tick, responder_.newest());
  }

  [[nodiscard]] bool complete(Clock::time_point now) const override {
    return pace_.over(responder_.newest(), last_tick_, now);
  }

  protocol::realtime::ReferenceResponder responder_;
  protocol::realtime::Pace pace_;
};

}  // namespace

void run_node(const experiment::Scenario& scenario, bus::Transport& transport, node::Link& link) {
  if (scenario.loop.mode == experiment::Mode::realtime) {
    RealtimeNode(scenario, transport, link).run();
  } else {
    LockstepNode(scenario, transport, link).run();
  }
}

}  // namespace tachless::reference

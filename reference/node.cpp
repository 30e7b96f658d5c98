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
    link_.run_until_finished([this](Clock::time_point now) { return complete(now); });
    link_.leave();
  }

 protected:
  Node(const experiment::Scenario& scenario, node::Link& link)
      : link_(link),
        last_tick_(scenario.loop.num_ticks - 1),
        period_s_(scenario.loop.period_s),
        trajectory_(make_trajectory(scenario)),
        channel_(loop::channel<loop::ReferencePoint>(scenario.robot.channel_prefix)),
        tick_codec_(loop::layout(scenario.num_joints, false)),
        reference_codec_(loop::layout(scenario.num_joints, false)) {
    link_.on(loop::channel<loop::Tick>(scenario.robot.channel_prefix),
             [this](const bus::Datagram& datagram) {
               loop::Stamp stamp;
               loop::Tick tick;
               if (link_.accept(tick_codec_, datagram, stamp, tick)) on_tick(stamp.tick, datagram);
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
    link_.count(verdict, loop::Role::plant, datagram, tick,
                [&] { return responder.sender_of(tick); });
    if (verdict != Verdict::fresh && verdict != Verdict::repeated) return false;
    link_.started(Clock::now());
    return true;
  }

  [[nodiscard]] std::size_t longest_tick() const { return tick_codec_.longest(); }
  [[nodiscard]] std::size_t longest_reference() const { return reference_codec_.longest(); }

  void publish(std::span<const std::byte> reference) {
    link_.transport().publish(channel_, reference);
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
    const auto bytes = reference_codec_.encode(stamp, reference);
    publish(bytes);
    link_.statistics().work_us.add(Clock::now() - begin);
    return bytes;
  }

  void answered(std::int64_t tick, std::int64_t newest) {
    link_.progressed(tick);
    link_.statistics().ticks = newest + 1;
  }

  node::Link& link_;
  std::int64_t last_tick_;

 private:
  double period_s_;
  Trajectory trajectory_;
  std::string channel_;
  bus::Codec<loop::Tick> tick_codec_;
  bus::Codec<loop::ReferencePoint> reference_codec_;
};

class LockstepNode final : public Node {
 public:
  LockstepNode(const experiment::Scenario& scenario, node::Link& link)
      : Node(scenario, link),
        responder_(scenario.loop.num_ticks, longest_tick(), longest_reference()) {}

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
  RealtimeNode(const experiment::Scenario& scenario, node::Link& link)
      : Node(scenario, link),
        responder_(scenario.loop.num_ticks, longest_tick()),
        pace_(scenario.loop.period_s) {}

 private:
  void on_tick(std::int64_t tick, const bus::Datagram& datagram) override {
    if (!pace_.possible(tick, Clock::now()) && !link_.knows(datagram.sender)) {
      return link_.count(Verdict::not_asked);
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

void run_node(const experiment::Scenario& scenario, node::Link& link) {
  if (scenario.loop.mode == experiment::Mode::realtime) {
    RealtimeNode(scenario, link).run();
  } else {
    LockstepNode(scenario, link).run();
  }
}

}  // namespace tachless::reference

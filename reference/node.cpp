#include "reference/node.h"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "bus/wire.h"
#include "protocol/lockstep/reference_responder.h"
#include "protocol/realtime/pace.h"
#include "protocol/realtime/reference_responder.h"
#include "reference/make_trajectory.h"

namespace tachless::reference {
namespace {

using loop::Clock;
using protocol::lockstep::Verdict;

/// What both modes share: hears TICK, publishes references.
class Node {
 public:
  Node(const Node&) = delete;
  Node& operator=(const Node&) = delete;
  virtual ~Node() = default;

  void run() {
    session_.meet();
    while (!session_.plant_finished()) {
      session_.attend(Clock::now());
      const auto datagram = transport_.receive(session_.next_attention());
      if (!datagram || session_.take(*datagram)) continue;
      if (datagram->channel == tick_channel_) on_tick(*datagram);
    }
    session_.finish();
  }

 protected:
  Node(const experiment::Scenario& scenario, bus::Transport& transport, node::Session& session)
      : transport_(transport),
        session_(session),
        period_s_(scenario.loop.period_s),
        trajectory_(make_trajectory(scenario)),
        tick_channel_(loop::channel<loop::Tick>(scenario.robot.channel_prefix)),
        reference_channel_(loop::channel<loop::ReferencePoint>(scenario.robot.channel_prefix)),
        tick_codec_(layout(scenario)),
        reference_codec_(layout(scenario)) {
    transport_.subscribe(tick_channel_);
  }

  /// A TICK of this run.
  virtual void on_tick(const loop::Stamp& stamp, const bus::Datagram& datagram) = 0;

  [[nodiscard]] std::size_t longest_tick() const { return tick_codec_.longest(); }
  [[nodiscard]] std::size_t longest_reference() const { return reference_codec_.longest(); }
  node::Session& session() { return session_; }

  void publish(std::span<const std::byte> reference) {
    transport_.publish(reference_channel_, reference);
  }

  /// Publishes the reference of tick k. The bytes are valid until the next call.
  std::span<const std::byte> compute(std::int64_t k) {
    const auto begin = Clock::now();
    const double time_s = static_cast<double>(k) * period_s_;
    const loop::ReferencePoint reference = trajectory_.at(time_s);
    if (!bus::all_finite(reference)) {
      throw diagnostics::Failure(diagnostics::ExitCode::protective_stop,
                                 "the reference at t = " + std::to_string(time_s) + " s (tick " +
                                     std::to_string(k) +
                                     ") is not finite; see `reference` in the scenario");
    }
    const loop::Stamp stamp{std::llround(time_s * 1e6), session_.run(), k};
    const auto bytes = reference_codec_.encode(stamp, reference);
    publish(bytes);
    session_.statistics().work.add(Clock::now() - begin);
    return bytes;
  }

  /// Whether the message is to be answered; counts it if it is not new.
  bool count(Verdict verdict) {
    node::Statistics& statistics = session_.statistics();
    if (verdict == Verdict::repeated) ++statistics.duplicates;
    if (verdict == Verdict::not_asked) statistics.rejected.add(node::Discard::not_asked);
    if (verdict == Verdict::too_old) statistics.rejected.add(node::Discard::too_old);
    return verdict == Verdict::fresh || verdict == Verdict::repeated;
  }

  [[nodiscard]] diagnostics::Failure two_plants(std::int64_t tick, std::string_view first,
                                                std::string_view second) const {
    return {diagnostics::ExitCode::protocol_violated,
            "two plants drive run " + std::to_string(session_.run()) + ": " + std::string(first) +
                " and " + std::string(second) + " sent different messages for tick " +
                std::to_string(tick) + "; end one of them"};
  }

 private:
  static loop::Layout layout(const experiment::Scenario& scenario) {
    return loop::layout(scenario.num_joints, false);
  }

  void on_tick(const bus::Datagram& datagram) {
    loop::Stamp stamp;
    loop::Tick tick;
    if (session_.accept(tick_codec_, datagram, stamp, tick)) on_tick(stamp, datagram);
  }

  bus::Transport& transport_;
  node::Session& session_;
  double period_s_;
  Trajectory trajectory_;
  std::string tick_channel_;
  std::string reference_channel_;
  bus::Codec<loop::Tick> tick_codec_;
  bus::Codec<loop::ReferencePoint> reference_codec_;
};

class LockstepNode final : public Node {
 public:
  LockstepNode(const experiment::Scenario& scenario, bus::Transport& transport,
               node::Session& session)
      : Node(scenario, transport, session),
        responder_(scenario.loop.num_ticks, longest_tick(), longest_reference()) {}

 private:
  void on_tick(const loop::Stamp& stamp, const bus::Datagram& datagram) override {
    const auto answer = responder_.on_tick(stamp.tick, datagram.payload, datagram.sender);
    if (answer.verdict == Verdict::conflicting) {
      throw two_plants(stamp.tick, responder_.sender_of(stamp.tick), datagram.sender);
    }
    if (!count(answer.verdict)) return;
    session().started(Clock::now());
    for (std::int64_t k = answer.repeat.first; k <= answer.repeat.last; ++k) {
      publish(responder_.kept(k));
      ++session().statistics().resends;
    }
    for (std::int64_t k = answer.compute.first; k <= answer.compute.last; ++k) {
      responder_.computed(k, compute(k));
    }
    session().progressed(stamp.tick);
    session().statistics().ticks = responder_.newest() + 1;
  }

  protocol::lockstep::ReferenceResponder responder_;
};

class RealtimeNode final : public Node {
 public:
  RealtimeNode(const experiment::Scenario& scenario, bus::Transport& transport,
               node::Session& session)
      : Node(scenario, transport, session),
        responder_(scenario.loop.num_ticks, longest_tick()),
        pace_(scenario.loop.period_s) {}

 private:
  void on_tick(const loop::Stamp& stamp, const bus::Datagram& datagram) override {
    const auto now = Clock::now();
    if (!pace_.possible(stamp.tick, now) && !session().knows(datagram.sender)) {
      count(Verdict::not_asked);
      return;
    }
    const auto answer = responder_.on_tick(stamp.tick, datagram.payload, datagram.sender);
    if (answer.verdict == Verdict::conflicting) {
      throw two_plants(stamp.tick, responder_.sender_of(stamp.tick), datagram.sender);
    }
    if (!count(answer.verdict)) return;
    session().started(now);
    for (std::int64_t k = answer.first; k <= answer.last; ++k) compute(k);
    session().progressed(stamp.tick);
    session().statistics().ticks = responder_.newest() + 1;
  }

  protocol::realtime::ReferenceResponder responder_;
  protocol::realtime::Pace pace_;
};

}  // namespace

void run_node(const experiment::Scenario& scenario, bus::Transport& transport,
              node::Session& session) {
  if (scenario.loop.mode == experiment::Mode::realtime) {
    RealtimeNode(scenario, transport, session).run();
  } else {
    LockstepNode(scenario, transport, session).run();
  }
}

}  // namespace tachless::reference

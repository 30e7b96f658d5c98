#include "reference/node.h"

#include <cmath>
#include <string>

#include "bus/lockstep/reference_answerer.h"
#include "bus/wire.h"
#include "reference/make_trajectory.h"

namespace reference {
namespace {

using bus::Clock;
using bus::lockstep::ReferenceAnswerer;
using bus::lockstep::Verdict;

class Node {
 public:
  Node(const app::Scenario& scenario, bus::Transport& transport, app::Session& session)
      : transport_(transport),
        session_(session),
        period_s_(scenario.loop.period_s),
        trajectory_(make_trajectory(scenario)),
        tick_channel_(bus::channel<bus::Tick>(scenario.robot.channel_prefix)),
        reference_channel_(bus::channel<robot::ReferencePoint>(scenario.robot.channel_prefix)),
        tick_codec_(layout(scenario)),
        reference_codec_(layout(scenario)),
        answerer_(scenario.loop.num_ticks, tick_codec_.longest(), reference_codec_.longest()) {
    transport_.subscribe(tick_channel_);
  }

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

 private:
  static bus::Layout layout(const app::Scenario& scenario) {
    return {.num_joints = scenario.num_joints, .num_motors = 0, .num_filters = 0};
  }

  void on_tick(const bus::Datagram& datagram) {
    bus::Stamp stamp;
    bus::Tick tick;
    app::Statistics& statistics = session_.statistics();
    const bus::Rejection rejection = tick_codec_.decode(datagram.payload, stamp, tick);
    if (rejection != bus::Rejection::none) return statistics.rejected.add(rejection);
    if (stamp.run != session_.run()) return statistics.rejected.add(app::Unusable::other_run);

    const auto answer = answerer_.on_tick(stamp.tick, datagram.payload, datagram.sender);
    switch (answer.verdict) {
      case Verdict::not_asked:
        return statistics.rejected.add(app::Unusable::not_asked);
      case Verdict::too_old:
        return statistics.rejected.add(app::Unusable::too_old);
      case Verdict::conflicting:
        throw app::Failure(app::ExitCode::protocol_violated,
                           "two plants drive run " + std::to_string(stamp.run) + ": " +
                               std::string(answerer_.asker(stamp.tick)) + " and " +
                               std::string(datagram.sender) + " sent different messages for tick " +
                               std::to_string(stamp.tick) + "; end one of them");
      case Verdict::repeated:
        ++statistics.duplicates;
        break;
      case Verdict::fresh:
        break;
    }
    session_.started(Clock::now());
    for (std::int64_t k = answer.repeat.first; k <= answer.repeat.last; ++k) {
      transport_.publish(reference_channel_, answerer_.kept(k));
      ++statistics.resends;
    }
    for (std::int64_t k = answer.compute.first; k <= answer.compute.last; ++k) compute(k);
    session_.progressed(stamp.tick);
    statistics.ticks = answerer_.newest() + 1;
  }

  void compute(std::int64_t k) {
    const auto begin = Clock::now();
    const double time_s = static_cast<double>(k) * period_s_;
    const robot::ReferencePoint reference = trajectory_.at(time_s);
    if (!bus::all_finite(reference)) {
      throw app::Failure(app::ExitCode::protective_stop,
                         "the reference at t = " + std::to_string(time_s) + " s (tick " +
                             std::to_string(k) +
                             ") is not finite; see `reference` in the scenario");
    }
    const bus::Stamp stamp{std::llround(time_s * 1e6), session_.run(), k};
    const auto bytes = reference_codec_.encode(stamp, reference);
    answerer_.computed(k, bytes);
    transport_.publish(reference_channel_, bytes);
    session_.statistics().work.add(Clock::now() - begin);
  }

  bus::Transport& transport_;
  app::Session& session_;
  double period_s_;
  Trajectory trajectory_;
  std::string tick_channel_;
  std::string reference_channel_;
  bus::Codec<bus::Tick> tick_codec_;
  bus::Codec<robot::ReferencePoint> reference_codec_;
  ReferenceAnswerer answerer_;
};

}  // namespace

void run_node(const app::Scenario& scenario, bus::Transport& transport, app::Session& session) {
  Node(scenario, transport, session).run();
}

}  // namespace reference

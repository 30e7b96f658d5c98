#include "controller/realtime_node.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <string>
#include <utility>

#include "controller/law_on_bus.h"
#include "diagnostics/logging.h"
#include "node/session.h"
#include "protocol/realtime/realtime.h"

namespace tachless::controller {
namespace {

class RealtimeNode {
 public:
  RealtimeNode(const experiment::Scenario& scenario, ScenarioLaw law, bus::Transport& transport,
               node::Session& session)
      : session_(session),
        loop_(transport, session),
        law_(scenario, std::move(law), transport, session),
        picker_(scenario.loop.num_ticks, law_.longest_measurement(), law_.longest_reference()),
        pace_(scenario.loop.period_s),
        num_ticks_(scenario.loop.num_ticks) {
    loop_.on(law_.measurement_channel(), [this](const auto& each) { on_measurement(each); });
    loop_.on(law_.reference_channel(), [this](const auto& each) { on_reference(each); });
  }

  void run() {
    session_.join(law_.info(), {});
    try {
      loop_.run_until_finished(
          [this](loop::Clock::time_point now) { return pace_.over(acted_, num_ticks_ - 1, now); });
    } catch (const diagnostics::Failure&) {
      tell_gaps();
      throw;
    }
    session_.leave();
    count_rest();
    tell_gaps();
  }

 private:
  using Input = protocol::realtime::CommandPicker::Input;
  using Verdict = protocol::lockstep::Verdict;

  void on_measurement(const bus::Datagram& datagram) {
    loop::Stamp stamp;
    if (!law_.accept_measurement(datagram, stamp)) return;
    const auto now = loop::Clock::now();
    if (!pace_.possible(stamp.tick, now) && !session_.knows(datagram.sender)) {
      return loop_.count(Verdict::not_asked);
    }
    const Verdict verdict = picker_.on_measurement(stamp.tick, datagram.payload, datagram.sender);
    loop_.count(verdict, loop::Role::plant, datagram, stamp.tick,
                [&] { return picker_.sender_of(Input::measurement, stamp.tick); });
    if (verdict != Verdict::fresh) return;
    law_.keep_measurement(stamp);
    session_.started(now);
    act();
  }

  void on_reference(const bus::Datagram& datagram) {
    loop::Stamp stamp;
    if (!law_.accept_reference(datagram, stamp)) return;
    // A reference is a tick ahead.
    if (!pace_.possible(std::max<std::int64_t>(stamp.tick - 1, 0), loop::Clock::now()) &&
        !session_.knows(datagram.sender)) {
      return loop_.count(Verdict::not_asked);
    }
    const Verdict verdict = picker_.on_reference(stamp.tick, datagram.payload, datagram.sender);
    loop_.count(verdict, loop::Role::reference, datagram, stamp.tick,
                [&] { return picker_.sender_of(Input::reference, stamp.tick); });
    if (verdict != Verdict::fresh) return;
    law_.keep_reference(stamp);
    act();
  }

  void act() {
    const auto due = picker_.due();
    if (!due) return;
    const auto result = law_.step(*due);
    picker_.acted(*due);
    acted_ = *due;
    node::ControllerStatistics& statistics = session_.statistics().controller();
    statistics.gaps += result.skipped > 0 ? 1 : 0;
    statistics.skipped_ticks += result.skipped;
    statistics.restarts += result.restarted ? 1 : 0;
  }

  /// The ticks that it never got to, since the run is over.
  void count_rest() {
    const std::int64_t rest = num_ticks_ - 1 - acted_;
    session_.statistics().controller().gaps += rest > 0 ? 1 : 0;
    session_.statistics().controller().skipped_ticks += rest;
  }

  void tell_gaps() const {
    const node::ControllerStatistics& statistics = session_.statistics().controller();
    if (statistics.gaps == 0) return;
    const std::string restarts =
        statistics.restarts == 0
            ? ""
            : fmt::format(", {} of them so long that the law's memory began anew",
                          statistics.restarts);
    diagnostics::log_warning(
        "{} ticks in {} gaps were passed over, for their measurement or reference came late or not "
        "at all{}",
        statistics.skipped_ticks, statistics.gaps, restarts);
  }

  node::Session& session_;
  node::Loop loop_;
  LawOnBus law_;
  protocol::realtime::CommandPicker picker_;
  protocol::realtime::Pace pace_;
  std::int64_t num_ticks_;
  std::int64_t acted_ = -1;  ///< newest tick commanded
};

}  // namespace

void run_realtime(const experiment::Scenario& scenario, ScenarioLaw law, bus::Transport& transport,
                  node::Session& session) {
  RealtimeNode(scenario, std::move(law), transport, session).run();
}

}  // namespace tachless::controller

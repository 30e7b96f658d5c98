#include "controller/lockstep_node.h"

#include <fmt/format.h>

#include <cstdint>
#include <utility>

#include "controller/law_on_bus.h"
#include "controller/recorded_inputs.h"
#include "diagnostics/logging.h"
#include "node/session.h"
#include "protocol/lockstep/responders.h"

namespace tachless::controller {
namespace {

class LockstepNode {
 public:
  LockstepNode(const experiment::Scenario& scenario, ScenarioLaw law, bus::Transport& transport,
               node::Session& session)
      : transport_(transport),
        session_(session),
        loop_(transport, session),
        law_(scenario, std::move(law), transport, session),
        responder_(scenario.loop.num_ticks, {law_.longest_measurement(), law_.longest_reference(),
                                             law_.longest_command(), law_.longest_state()}) {
    loop_.on(law_.measurement_channel(), [this](const auto& each) { on_measurement(each); });
    loop_.on(law_.reference_channel(), [this](const auto& each) { on_reference(each); });
  }

  /// `log`: of a run under way, to be resumed.
  void run(const std::optional<std::filesystem::path>& log) {
    session_.join(law_.info(), {});
    if (log) resume(*log);
    loop_.run_until_finished([this](auto) { return responder_.all_computed(); });
    session_.leave();
  }

 private:
  using Responder = protocol::lockstep::CommandResponder;
  using Input = Responder::Input;
  using Verdict = protocol::lockstep::Verdict;

  /// Rebuilds the law's memory from the run's inputs in the log; what came after them the plant
  /// asks again.
  void resume(const std::filesystem::path& log) {
    constexpr std::int64_t ticks_alone = 256;  // between two looks at the bus
    RecordedInputs inputs(log, law_.measurement_channel(), law_.reference_channel(),
                          session_.run());
    while (const auto tick = inputs.next()) {
      if (!law_.rebuild(tick->tick, tick->measurement, tick->reference)) {
        throw inputs.unusable(fmt::format("tick {} is damaged", tick->tick));
      }
      if (tick->tick % ticks_alone == 0) session_.handle_pending();
    }
    session_.handle_pending();
    const std::int64_t begun = session_.tick_of(loop::Role::plant) + 1;
    if (begun >= inputs.next_tick() + Responder::reach) {
      throw inputs.unusable(
          fmt::format("it ends before tick {}, the run is at tick {}, and no more than {} ticks "
                      "can be asked again",
                      inputs.next_tick(), begun, Responder::reach));
    }
    responder_.resume(inputs.next_tick());
    diagnostics::log_info("resumed run {} at tick {}", session_.run(), inputs.next_tick());
  }

  void on_measurement(const bus::Datagram& datagram) {
    loop::Stamp stamp;
    if (!law_.accept_measurement(datagram, stamp)) return;
    const auto answer = responder_.on_measurement(stamp.tick, datagram.payload, datagram.sender);
    loop_.count(answer.verdict, loop::Role::plant, datagram, stamp.tick,
                [&] { return responder_.sender_of(Input::measurement, stamp.tick); });
    if (answer.verdict == Verdict::fresh) law_.keep_measurement(stamp);
    if (answer.verdict == Verdict::fresh || answer.verdict == Verdict::repeated) {
      session_.started(loop::Clock::now());
    }
    act(answer.action, stamp.tick);
  }

  void on_reference(const bus::Datagram& datagram) {
    loop::Stamp stamp;
    if (!law_.accept_reference(datagram, stamp)) return;
    const auto answer = responder_.on_reference(stamp.tick, datagram.payload, datagram.sender);
    loop_.count(answer.verdict, loop::Role::reference, datagram, stamp.tick,
                [&] { return responder_.sender_of(Input::reference, stamp.tick); });
    if (answer.verdict == Verdict::fresh) law_.keep_reference(stamp);
    act(answer.action, stamp.tick);
  }

  void act(Responder::Action action, std::int64_t tick) {
    if (action == Responder::Action::compute) {
      do {
        const auto result = law_.step(responder_.next());
        responder_.computed(result.command, result.state);
      } while (responder_.ready());
    } else if (action == Responder::Action::repeat) {
      transport_.publish(law_.command_channel(), responder_.command(tick));
      transport_.publish(law_.state_channel(), responder_.state(tick));
      session_.statistics().resends += 2;
    }
  }

  bus::Transport& transport_;
  node::Session& session_;
  node::Loop loop_;
  LawOnBus law_;
  Responder responder_;
};

}  // namespace

void run_lockstep(const experiment::Scenario& scenario, ScenarioLaw law, bus::Transport& transport,
                  node::Session& session, const std::optional<std::filesystem::path>& resume) {
  LockstepNode(scenario, std::move(law), transport, session).run(resume);
}

}  // namespace tachless::controller

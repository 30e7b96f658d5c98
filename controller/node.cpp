#include "controller/node.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <utility>

#include "base/failure.h"
#include "base/logging.h"
#include "base/tick_ring.h"
#include "base/users_code.h"
#include "controller/spec.h"
#include "messages/wire.h"
#include "session/responders.h"

namespace tachless::controller {
namespace {

using base::Clock;
using messages::Role;
using session::CommandPicker;
using session::CommandResponder;
using session::Receipt;

/// One of the law's two inputs: the decoded values of the last ticks in a preallocated ring.
template <class Value>
struct Input : messages::Port<Value> {
  struct Message {
    messages::Stamp stamp;
    Value value;
  };
  base::TickRing<Message> kept{session::MessageRing::depth};

  explicit Input(messages::Port<Value> port) : messages::Port<Value>(std::move(port)) {}

  void keep(const messages::Stamp& stamp, const Value& value) {
    Message& message = kept[stamp.tick];
    message.stamp = stamp;
    message.value = value;
  }
};

session::LawInput input_of(Role from) {
  return from == Role::plant ? session::measurement_input : session::reference_input;
}

/// Base of both modes: receives the law's inputs, steps the law over a tick, and publishes command
/// and state. The derived classes decide which tick is due.
class Node {
 public:
  Node(const Node&) = delete;
  Node& operator=(const Node&) = delete;
  virtual ~Node() = default;

 protected:
  Node(const scenario::Scenario& scenario, ScenarioLaw law, session::Session& session)
      : session_(session),
        law_(std::move(law)),
        users_(scenario.controller.law == external_law_name),
        info_(law_info(*law_)),
        prefix_(scenario.robot.channel_prefix),
        layout_(law_layout(scenario, *law_)),
        measurement_({messages::channel(prefix_, info_.measurement), {info_.measurement, layout_}}),
        reference_(messages::port<messages::ReferencePoint>(prefix_, layout_)),
        command_(messages::port<messages::TorqueCommand>(prefix_, layout_)),
        state_(messages::port<messages::LawSignals>(prefix_, layout_)) {
    receive(measurement_, Role::plant);
    receive(reference_, Role::reference);
  }

  /// Judges a valid message of this run, before the message is counted and kept.
  virtual Receipt judge(Role from, std::int64_t tick, const bus::Datagram& datagram) = 0;
  /// Acts on the judged message.
  virtual void act(Role from, std::int64_t tick, Receipt receipt) = 0;

  void join() {
    base::log_detail("law {}, measures {}, publishes its signals {}", info_.law, info_.measurement,
                     info_.signals);
    session_.join(info_, {});
  }

  /// Steps the law over `tick`, whose inputs have been kept, and publishes command and state.
  /// @throw base::Failure(protective_stop) when the result is not finite, and when a user's law
  /// throws or returns another number of joints or signals.
  Outcome compute(std::int64_t tick) {
    const auto begin = Clock::now();
    const messages::Stamp& asked = measurement_.kept[tick].stamp;
    const messages::AnyMeasurement& measurement = measurement_.kept[tick].value;
    const messages::Stamp stamp{asked.utime, session_.run(), tick};
    const auto step = [&] { return law_->step(tick, measurement, reference_.kept[tick].value); };
    const Outcome outcome = users_ ? base::call_users("the law", step) : step();
    if (users_) require_sizes(outcome, tick);
    command_bytes_ = session_.publish(command_, stamp, outcome.command);
    state_bytes_ = session_.publish(state_, stamp, outcome.signals);

    // stableNorm avoids overflow of the squares of a finite error. The norm of several joints may
    // still overflow, hence min.
    const auto& signals = outcome.signals;
    const double error_norm = signals.num > 0 ? signals.value[0].stableNorm() : 0;
    session_.note_progress(tick, std::min(error_norm, std::numeric_limits<double>::max()));
    session_.statistics().ticks = tick + 1;
    session_.statistics().work_us.add(Clock::now() - begin);
    return outcome;
  }

  session::Session& session_;
  ScenarioLaw law_;
  bool users_;  ///< the law is of another program
  messages::LawInfo info_;
  std::string prefix_;  ///< prefix of the robot's channels
  messages::Layout layout_;
  Input<messages::AnyMeasurement> measurement_;
  Input<messages::ReferencePoint> reference_;
  messages::Port<messages::TorqueCommand> command_;
  messages::Port<messages::LawSignals> state_;
  std::span<const std::byte> command_bytes_, state_bytes_;  ///< messages of the newest tick

 private:
  void require_sizes(const Outcome& outcome, std::int64_t tick) const {
    const Eigen::Index joints = layout_.num_joints, torques = outcome.command.tau.size();
    const messages::LawSignals& signals = outcome.signals;
    bool whole = torques == joints && signals.num == layout_.num_signals;
    for (int i = 0; whole && i < signals.num; ++i) {
      whole = signals.value[static_cast<std::size_t>(i)].size() == joints;
    }
    if (whole) return;
    throw base::Failure(base::ExitCode::protective_stop,
                        "the law {} returned {} torques and {} signals at tick {}; the robot has "
                        "{} joints and the law declares {} signals, each with a value for each "
                        "joint",
                        law_->name(), torques, signals.num, tick, joints, layout_.num_signals);
  }

  template <class Value>
  void receive(Input<Value>& input, Role from) {
    session_.on(input, [this, &input, from](const messages::Stamp& stamp, const Value& value,
                                            const bus::Datagram& datagram) {
      const Receipt receipt = judge(from, stamp.tick, datagram);
      session_.count(receipt, from, datagram, stamp.tick);
      if (receipt == Receipt::fresh) input.keep(stamp, value);
      act(from, stamp.tick, receipt);
    });
  }
};

/// Lockstep node, which computes every tick once and in order.
class LockstepNode final : public Node {
 public:
  LockstepNode(const scenario::Scenario& scenario, ScenarioLaw law, session::Session& session)
      : Node(scenario, std::move(law), session),
        responder_(scenario.loop.num_ticks, command_.codec.longest(), state_.codec.longest()) {}

  void run() {
    join();
    session_.run_until_finished([this](auto) { return responder_.is_all_computed(); });
    session_.leave();
  }

 private:
  using Action = CommandResponder::Action;

  Receipt judge(Role from, std::int64_t tick, const bus::Datagram& datagram) override {
    const auto answer = responder_.on_input(input_of(from), tick, datagram.payload);
    action_ = answer.action;
    return answer.receipt;
  }

  void act(Role from, std::int64_t tick, Receipt receipt) override {
    const bool asked = receipt == Receipt::fresh || receipt == Receipt::repeated;
    if (from == Role::plant && asked) session_.note_started(Clock::now());
    if (action_ == Action::compute) {
      compute(responder_.next());
      responder_.on_computed(command_bytes_, state_bytes_);
    } else if (action_ == Action::repeat) {
      session_.publish(command_.channel, responder_.command(tick));
      session_.publish(state_.channel, responder_.state(tick));
      session_.statistics().resends += 2;
    }
  }

  CommandResponder responder_;
  Action action_ = Action::nothing;  ///< action that the last judged message asks for
};

/// Realtime node, which acts on the newest measurement whose reference has arrived. It skips ticks
/// with lost messages, and so does the law (`AnyLaw`). It counts the gaps and reports them at the
/// end.
class RealtimeNode final : public Node {
 public:
  RealtimeNode(const scenario::Scenario& scenario, ScenarioLaw law, session::Session& session)
      : Node(scenario, std::move(law), session),
        picker_(scenario.loop.num_ticks),
        pace_(scenario.loop.period_s),
        last_tick_(scenario.loop.num_ticks - 1) {}

  void run() {
    join();
    try {
      session_.run_until_finished(
          [this](Clock::time_point now) { return pace_.over(acted_, last_tick_, now); });
    } catch (const base::Failure&) {
      report_gaps();
      throw;
    }
    session_.leave();
    count_gap(last_tick_ - acted_);  // ticks after the last command
    report_gaps();
  }

 private:
  Receipt judge(Role from, std::int64_t tick, const bus::Datagram& datagram) override {
    // A reference is a tick ahead.
    const std::int64_t begun = from == Role::plant ? tick : std::max<std::int64_t>(tick - 1, 0);
    if (!pace_.possible(begun, Clock::now()) && !session_.membership().knows(datagram.sender)) {
      return Receipt::not_asked;
    }
    return picker_.on_input(input_of(from), tick, datagram.payload);
  }

  void act(Role from, std::int64_t tick, Receipt receipt) override {
    if (receipt != Receipt::fresh) return;
    if (from == Role::plant) {
      session_.note_started(Clock::now());
    } else {
      law_->prepare(reference_.kept[tick].value);  // a reference is a tick ahead
    }
    const auto due = picker_.due();
    if (!due) return;
    const auto outcome = compute(*due);
    picker_.on_acted(*due);
    acted_ = *due;
    count_gap(outcome.skipped);
    statistics().restarts += outcome.restarted ? 1 : 0;
  }

  session::ControllerStatistics& statistics() { return session_.statistics().controller(); }

  void count_gap(std::int64_t ticks) {
    statistics().gaps += ticks > 0 ? 1 : 0;
    statistics().skipped_ticks += ticks;
  }

  void report_gaps() {
    const session::ControllerStatistics& counted = statistics();
    if (counted.gaps == 0) return;
    const std::string restarts =
        counted.restarts == 0 ? ""
                              : fmt::format(", {} of them so long that the law's memory began anew",
                                            counted.restarts);
    base::log_warning(
        "{} ticks in {} gaps were skipped because their measurement or reference came late or not "
        "at all{}",
        counted.skipped_ticks, counted.gaps, restarts);
  }

  CommandPicker picker_;
  session::Pace pace_;
  std::int64_t last_tick_;
  std::int64_t acted_ = -1;  ///< newest tick with a command
};

}  // namespace

void run_node(const scenario::Scenario& scenario, ScenarioLaw law, session::Session& session) {
  if (scenario.loop.mode == scenario::Mode::realtime) {
    RealtimeNode(scenario, std::move(law), session).run();
  } else {
    LockstepNode(scenario, std::move(law), session).run();
  }
}

}  // namespace tachless::controller

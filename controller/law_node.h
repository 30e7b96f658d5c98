#pragma once

#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "app/scenario.h"
#include "app/session.h"
#include "bus/lockstep/command_answerer.h"
#include "bus/transport.h"
#include "bus/wire.h"
#include "controller/law/law.h"

namespace controller {

/// The loop around one law: what it measures is what its type says, so is the channel.
template <law::Law L>
class LawNode {
 public:
  using Measurement = typename L::Measurement;

  LawNode(const app::Scenario& scenario, const L& law, bus::Transport& transport,
          app::Session& session)
      : law_(law),
        transport_(transport),
        session_(session),
        measurement_channel_(bus::channel<Measurement>(scenario.robot.channel_prefix)),
        reference_channel_(bus::channel<robot::ReferencePoint>(scenario.robot.channel_prefix)),
        command_channel_(bus::channel<robot::TorqueCommand>(scenario.robot.channel_prefix)),
        state_channel_(bus::channel<robot::ControllerState>(scenario.robot.channel_prefix)),
        measurement_codec_(layout(scenario)),
        reference_codec_(layout(scenario)),
        command_codec_(layout(scenario)),
        state_codec_(layout(scenario)),
        answerer_(scenario.loop.num_ticks,
                  {measurement_codec_.longest(), reference_codec_.longest(),
                   command_codec_.longest(), state_codec_.longest()}) {
    transport_.subscribe(measurement_channel_);
    transport_.subscribe(reference_channel_);
  }

  void run() {
    session_.meet(std::string(bus::ChannelOf<Measurement>::suffix));
    while (!session_.plant_finished()) {
      session_.attend(bus::Clock::now());
      const auto datagram = transport_.receive(session_.next_attention());
      if (!datagram || session_.take(*datagram)) continue;
      if (datagram->channel == measurement_channel_) {
        on_measurement(*datagram);
      } else if (datagram->channel == reference_channel_) {
        on_reference(*datagram);
      }
    }
    session_.finish();
  }

 private:
  using Answerer = bus::lockstep::CommandAnswerer;
  using Verdict = bus::lockstep::Verdict;

  static bus::Layout layout(const app::Scenario& scenario) {
    return {.num_joints = scenario.num_joints,
            .num_motors = scenario.robot.flexible ? scenario.num_joints : 0,
            .num_filters = L::num_filters};
  }

  /// Whether a message is of this run and sound; counts it if not.
  template <class Value>
  bool accept(const bus::Codec<Value>& codec, const bus::Datagram& datagram, bus::Stamp& stamp,
              Value& value) {
    const bus::Rejection rejection = codec.decode(datagram.payload, stamp, value);
    if (rejection != bus::Rejection::none) {
      session_.statistics().rejected.add(rejection);
    } else if (stamp.run != session_.run()) {
      session_.statistics().rejected.add(app::Unusable::other_run);
    } else {
      return true;
    }
    return false;
  }

  void on_measurement(const bus::Datagram& datagram) {
    bus::Stamp stamp;
    if (!accept(measurement_codec_, datagram, stamp, measurement_)) return;
    const auto answer = answerer_.on_measurement(stamp.tick, datagram.payload, datagram.sender);
    if (answer.verdict == Verdict::conflicting) {
      throw violated("two plants", stamp.tick, answerer_.asker(stamp.tick), datagram.sender);
    }
    if (count(answer.verdict)) session_.started(bus::Clock::now());
    act(answer.action, stamp.tick);
  }

  void on_reference(const bus::Datagram& datagram) {
    bus::Stamp stamp;
    if (!accept(reference_codec_, datagram, stamp, reference_)) return;
    const auto answer = answerer_.on_reference(stamp.tick, datagram.payload, datagram.sender);
    if (answer.verdict == Verdict::conflicting) {
      throw violated("two references", stamp.tick, answerer_.referrer(stamp.tick), datagram.sender);
    }
    count(answer.verdict);
    act(answer.action, stamp.tick);
  }

  /// Whether the message belongs to the run; counts it if it is not new.
  bool count(Verdict verdict) {
    app::Statistics& statistics = session_.statistics();
    if (verdict == Verdict::repeated) ++statistics.duplicates;
    if (verdict == Verdict::not_asked) statistics.rejected.add(app::Unusable::not_asked);
    if (verdict == Verdict::too_old) statistics.rejected.add(app::Unusable::too_old);
    return verdict == Verdict::fresh || verdict == Verdict::repeated;
  }

  void act(Answerer::Action action, std::int64_t tick) {
    if (action == Answerer::Action::compute) {
      compute();
    } else if (action == Answerer::Action::repeat) {
      transport_.publish(command_channel_, answerer_.command(tick));
      transport_.publish(state_channel_, answerer_.state(tick));
      session_.statistics().resends += 2;
    }
  }

  void compute() {
    const auto begin = bus::Clock::now();
    const std::int64_t k = answerer_.next();
    bus::Stamp stamp;
    require(measurement_codec_.decode(answerer_.measurement(k), stamp, measurement_));
    const std::int64_t utime = stamp.utime;
    require(reference_codec_.decode(answerer_.reference(k), stamp, reference_));

    if (!memory_) memory_ = law_.start(measurement_, reference_);
    auto step = law_.step(*memory_, measurement_, reference_);
    if (!bus::all_finite(step.command) || !bus::all_finite(step.state)) throw not_finite(step, k);
    memory_ = step.memory;

    const bus::Stamp answer{utime, session_.run(), k};
    const auto command = command_codec_.encode(answer, step.command);
    transport_.publish(command_channel_, command);
    const auto state = state_codec_.encode(answer, step.state);
    answerer_.computed(command, state);
    transport_.publish(state_channel_, state);

    session_.progressed(k, step.state.num_filters > 0 ? step.state.error[0].norm() : 0);
    session_.statistics().ticks = k + 1;
    session_.statistics().work.add(bus::Clock::now() - begin);
  }

  static void require(bus::Rejection rejection) {
    if (rejection != bus::Rejection::none) {
      throw std::logic_error("a kept message has changed: " + std::string(bus::name(rejection)));
    }
  }

  static app::Failure not_finite(const law::Step<typename L::Memory>& step, std::int64_t tick) {
    std::string where = "the state";
    for (Eigen::Index i = 0; i < step.command.tau.size(); ++i) {
      if (!std::isfinite(step.command.tau[i])) {
        where = "the torque of joint " + std::to_string(i + 1);
        break;
      }
    }
    return {app::ExitCode::protective_stop,
            where + " of law " + std::string(L::name) + " at tick " + std::to_string(tick) +
                " is not finite: the loop is unstable; compare its period with the limit that "
                "`tachless certify` gives for these gains"};
  }

  app::Failure violated(std::string_view who, std::int64_t tick, std::string_view first,
                        std::string_view second) const {
    return {app::ExitCode::protocol_violated,
            std::string(who) + " take part in run " + std::to_string(session_.run()) + ": " +
                std::string(first) + " and " + std::string(second) +
                " sent different messages for tick " + std::to_string(tick) + "; end one of them"};
  }

  const L& law_;
  bus::Transport& transport_;
  app::Session& session_;
  std::string measurement_channel_;
  std::string reference_channel_;
  std::string command_channel_;
  std::string state_channel_;
  bus::Codec<Measurement> measurement_codec_;
  bus::Codec<robot::ReferencePoint> reference_codec_;
  bus::Codec<robot::TorqueCommand> command_codec_;
  bus::Codec<robot::ControllerState> state_codec_;
  Answerer answerer_;
  Measurement measurement_;
  robot::ReferencePoint reference_;
  std::optional<typename L::Memory> memory_;  ///< nothing before the first step
};

}  // namespace controller

#pragma once

#include <cmath>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "bus/transport.h"
#include "bus/wire.h"
#include "controller/law/law.h"
#include "controller/law_stepper.h"
#include "experiment/scenario.h"
#include "node/session.h"
#include "protocol/lockstep/verdict.h"

namespace tachless::controller {

/// One law as the bus sees it: the channels and codecs that belong to it (what it measures is what
/// its type says, so is the channel), and one tick from input bytes to published output. Knows
/// nothing of which tick is due.
template <law::Law L>
class LawOnBus {
 public:
  using Measurement = typename L::Measurement;

  LawOnBus(const experiment::Scenario& scenario, bus::Transport& transport, node::Session& session)
      : stepper_(scenario),
        transport_(transport),
        session_(session),
        measurement_channel_(loop::channel<Measurement>(scenario.robot.channel_prefix)),
        reference_channel_(loop::channel<loop::ReferencePoint>(scenario.robot.channel_prefix)),
        command_channel_(loop::channel<loop::TorqueCommand>(scenario.robot.channel_prefix)),
        state_channel_(loop::channel<loop::ControllerState>(scenario.robot.channel_prefix)),
        measurement_codec_(layout(scenario)),
        reference_codec_(layout(scenario)),
        command_codec_(layout(scenario)),
        state_codec_(layout(scenario)) {
    transport_.subscribe(measurement_channel_);
    transport_.subscribe(reference_channel_);
  }

  /// To be told at the rendezvous.
  [[nodiscard]] static std::string needs() {
    return std::string(loop::ChannelOf<Measurement>::suffix);
  }
  [[nodiscard]] const std::string& measurement_channel() const { return measurement_channel_; }
  [[nodiscard]] const std::string& reference_channel() const { return reference_channel_; }
  [[nodiscard]] const std::string& command_channel() const { return command_channel_; }
  [[nodiscard]] const std::string& state_channel() const { return state_channel_; }

  /// Longest messages [bytes].
  [[nodiscard]] std::size_t longest_measurement() const { return measurement_codec_.longest(); }
  [[nodiscard]] std::size_t longest_reference() const { return reference_codec_.longest(); }
  [[nodiscard]] std::size_t longest_command() const { return command_codec_.longest(); }
  [[nodiscard]] std::size_t longest_state() const { return state_codec_.longest(); }

  /// Whether a message is of this run and sound; counts it if not.
  bool accept_measurement(const bus::Datagram& datagram, loop::Stamp& stamp) {
    return session_.accept(measurement_codec_, datagram, stamp, measurement_);
  }
  bool accept_reference(const bus::Datagram& datagram, loop::Stamp& stamp) {
    return session_.accept(reference_codec_, datagram, stamp, reference_);
  }

  /// What became of one tick. Bytes are valid until the next call.
  struct Result {
    std::span<const std::byte> command;
    std::span<const std::byte> state;
    std::int64_t skipped = 0;
    bool restarted = false;
  };

  /// Steps the law over `tick` and publishes command and state. The inputs have been accepted.
  /// @throw diagnostics::Failure(protective_stop) when the result is not finite.
  Result step(std::int64_t tick, std::span<const std::byte> measurement,
              std::span<const std::byte> reference) {
    const auto begin = loop::Clock::now();
    const loop::Stamp answer{decode(measurement, reference), session_.run(), tick};
    const auto outcome = advance(tick);
    const auto& step = outcome.step;
    const auto command = command_codec_.encode(answer, step.command);
    transport_.publish(command_channel_, command);
    const auto state = state_codec_.encode(answer, step.state);
    transport_.publish(state_channel_, state);

    session_.progressed(tick, step.state.num_filters > 0 ? step.state.error[0].norm() : 0);
    session_.statistics().ticks = tick + 1;
    session_.statistics().work.add(loop::Clock::now() - begin);
    return {command, state, outcome.skipped, outcome.restarted};
  }

  /// Steps the law over `tick`, whose command is out already: for its memory alone.
  void rebuild(std::int64_t tick, std::span<const std::byte> measurement,
               std::span<const std::byte> reference) {
    decode(measurement, reference);
    advance(tick);
    session_.progressed(tick);
    session_.statistics().ticks = tick + 1;
  }

  /// Whether a message out of a log is sound and what it claims to be.
  bool sound_measurement(std::span<const std::byte> bytes) {
    loop::Stamp stamp;
    return measurement_codec_.decode(bytes, stamp, measurement_) == bus::Rejection::none;
  }
  bool sound_reference(std::span<const std::byte> bytes) {
    loop::Stamp stamp;
    return reference_codec_.decode(bytes, stamp, reference_) == bus::Rejection::none;
  }

  /// Counts a message that is not new.
  void count(protocol::lockstep::Verdict verdict) {
    using protocol::lockstep::Verdict;
    node::Statistics& statistics = session_.statistics();
    if (verdict == Verdict::repeated) ++statistics.duplicates;
    if (verdict == Verdict::not_asked) statistics.rejected.add(node::Unusable::not_asked);
    if (verdict == Verdict::too_old) statistics.rejected.add(node::Unusable::too_old);
  }

  /// What to throw when two processes play one role.
  [[nodiscard]] diagnostics::Failure violated(std::string_view who, std::int64_t tick,
                                              std::string_view first,
                                              std::string_view second) const {
    return {diagnostics::ExitCode::protocol_violated,
            std::string(who) + " take part in run " + std::to_string(session_.run()) + ": " +
                std::string(first) + " and " + std::string(second) +
                " sent different messages for tick " + std::to_string(tick) + "; end one of them"};
  }

 private:
  /// @return the tick's time [us]
  std::int64_t decode(std::span<const std::byte> measurement,
                      std::span<const std::byte> reference) {
    loop::Stamp stamp;
    require(measurement_codec_.decode(measurement, stamp, measurement_));
    const std::int64_t utime = stamp.utime;
    require(reference_codec_.decode(reference, stamp, reference_));
    return utime;
  }

  typename LawStepper<L>::Outcome advance(std::int64_t tick) {
    auto outcome = stepper_.step(tick, measurement_, reference_);
    if (!bus::all_finite(outcome.step.command) || !bus::all_finite(outcome.step.state)) {
      throw not_finite(outcome.step, tick);
    }
    stepper_.keep(tick, outcome.step.memory);
    return outcome;
  }

  static loop::Layout layout(const experiment::Scenario& scenario) {
    return {.num_joints = scenario.num_joints,
            .num_motors = scenario.robot.flexible ? scenario.num_joints : 0,
            .num_filters = L::num_filters};
  }

  static void require(bus::Rejection rejection) {
    if (rejection != bus::Rejection::none) {
      throw std::logic_error("a kept message has changed: " + std::string(bus::name(rejection)));
    }
  }

  static diagnostics::Failure not_finite(const law::Step<typename L::Memory>& step,
                                         std::int64_t tick) {
    std::string where = "the state";
    for (Eigen::Index i = 0; i < step.command.tau.size(); ++i) {
      if (!std::isfinite(step.command.tau[i])) {
        where = "the torque of joint " + std::to_string(i + 1);
        break;
      }
    }
    return {diagnostics::ExitCode::protective_stop,
            where + " of law " + std::string(L::name) + " at tick " + std::to_string(tick) +
                " is not finite: the loop is unstable; shorten loop.period_s or soften the "
                "gains (docs/laws tells the limit)"};
  }

  LawStepper<L> stepper_;
  bus::Transport& transport_;
  node::Session& session_;
  std::string measurement_channel_;
  std::string reference_channel_;
  std::string command_channel_;
  std::string state_channel_;
  bus::Codec<Measurement> measurement_codec_;
  bus::Codec<loop::ReferencePoint> reference_codec_;
  bus::Codec<loop::TorqueCommand> command_codec_;
  bus::Codec<loop::ControllerState> state_codec_;
  Measurement measurement_;
  loop::ReferencePoint reference_;
};

}  // namespace tachless::controller

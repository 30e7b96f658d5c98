#include "plant/robot_on_bus.h"

#include <cmath>
#include <stdexcept>

#include "app/version.h"
#include "plant/plant_model.h"

namespace plant {
namespace {

using bus::Clock;

bus::Layout layout_of(const app::Scenario& scenario) {
  return {.num_joints = scenario.num_joints,
          .num_motors = scenario.robot.flexible ? scenario.num_joints : 0,
          .num_filters = 0};
}

}  // namespace

RobotOnBus::RobotOnBus(const app::Scenario& scenario, app::Session& session)
    : scenario_(scenario),
      session_(session),
      model_(plant_model(scenario)),
      arm_(make_arm(scenario, model_)),
      encoder_(scenario, model_),
      drive_(make_drive(scenario, model_)),
      layout_(layout_of(scenario)),
      tick_channel_(bus::channel<bus::Tick>(scenario.robot.channel_prefix)),
      command_channel_(bus::channel<robot::TorqueCommand>(scenario.robot.channel_prefix)),
      truth_channel_(bus::channel<bus::truth::PlantTruth>(scenario.robot.channel_prefix)),
      run_info_channel_(bus::channel<bus::RunInfo>(scenario.robot.channel_prefix)),
      ack_channel_(bus::channel<bus::LogAck>(scenario.robot.channel_prefix)),
      tick_codec_(layout_),
      command_codec_(layout_),
      truth_codec_(layout_),
      ack_codec_(layout_) {
  session_.statistics().saturated_ticks.assign(static_cast<std::size_t>(scenario.num_joints), 0);
}

void RobotOnBus::prepare() {
  measurement_ = make_measurement_source(session_.measurement(), scenario_, encoder_, layout_);
  measurement_channel_ = measurement_->channel();

  bus::RunInfo info;
  info.num_ticks = scenario_.loop.num_ticks;
  info.period_s = scenario_.loop.period_s;
  info.version = app::version;
  info.robot = scenario_.robot.channel_prefix;
  info.measurement = session_.measurement();
  info.scenario = scenario_.text;
  info.robot_description = scenario_.robot.urdf_text;
  try {
    bus::Codec<bus::RunInfo> codec(layout_);
    const auto bytes = codec.encode({0, session_.run(), -1}, info);
    run_info_.assign(bytes.begin(), bytes.end());
  } catch (const std::length_error&) {
    throw app::Failure(app::ExitCode::bad_usage,
                       scenario_.source + ": scenario and URDF have " +
                           std::to_string(info.scenario.size() + info.robot_description.size()) +
                           " characters together; allowed: about " +
                           std::to_string(bus::max_run_info_size - 200) +
                           ", for a log holds them in one message");
  }
}

bus::Stamp RobotOnBus::stamp(std::int64_t tick) const {
  const double time_s = static_cast<double>(tick) * scenario_.loop.period_s;
  return {std::llround(time_s * 1e6), session_.run(), tick};
}

std::span<const std::byte> RobotOnBus::measurement(std::int64_t tick) {
  return measurement_->measure(arm_.state(), stamp(tick));
}

std::span<const std::byte> RobotOnBus::tick(const bus::Stamp& stamp) {
  return tick_codec_.encode(stamp, {.last = stamp.tick + 1 == scenario_.loop.num_ticks});
}

std::span<const std::byte> RobotOnBus::truth(std::int64_t tick, bus::truth::DriveFault fault) {
  const AppliedTorque& applied = drive_.applied();
  const ArmState& state = arm_.state();
  truth_.q = state.q;
  truth_.v = state.v;
  truth_.theta = state.theta;
  truth_.thetadot = state.thetadot;
  truth_.tau = applied.tau;
  truth_.saturated = applied.saturated;
  truth_.fault = fault;
  for (int i = 0; i < scenario_.num_joints; ++i) {
    const auto joint = static_cast<std::size_t>(i);
    session_.statistics().saturated_ticks[joint] += applied.saturated[joint] ? 1 : 0;
  }
  if (!bus::truth::all_finite(truth_)) {
    throw app::Failure(app::ExitCode::protective_stop,
                       "the plant's state at tick " + std::to_string(tick) +
                           " is not finite: the loop is unstable; compare its period with the "
                           "limit in docs/laws for these gains");
  }
  return truth_codec_.encode(stamp(tick), truth_);
}

bool RobotOnBus::hear_command(const bus::Datagram& datagram, bus::Stamp& stamp) {
  const bus::Rejection rejection = command_codec_.decode(datagram.payload, stamp, command_);
  if (rejection == bus::Rejection::non_finite) {
    const bus::Stamp heard = bus::stamp_of(datagram.payload);
    if (heard.run == session_.run() && session_.is_from(bus::Role::controller, datagram.sender)) {
      session_.statistics().rejected.add(rejection);
      throw app::Failure(app::ExitCode::protective_stop,
                         session_.describe(bus::Role::controller) +
                             " commanded a torque that is not finite for tick " +
                             std::to_string(heard.tick) +
                             ": the loop is unstable, or the controller is broken; shorten "
                             "loop.period_s or soften the gains (docs/laws tells the limit)");
    }
  }
  if (rejection != bus::Rejection::none) {
    session_.statistics().rejected.add(rejection);
  } else if (stamp.run != session_.run()) {
    session_.statistics().rejected.add(app::Unusable::other_run);
  } else {
    return true;
  }
  return false;
}

bool RobotOnBus::hear_ack(const bus::Datagram& datagram, bus::Stamp& stamp, bus::LogAck& ack) {
  return session_.accept(ack_codec_, datagram, stamp, ack);
}

bool RobotOnBus::is_command(std::span<const std::byte> payload) const {
  bus::Stamp stamp;
  robot::TorqueCommand command;
  const bus::Rejection rejection = command_codec_.decode(payload, stamp, command);
  return rejection == bus::Rejection::none || rejection == bus::Rejection::non_finite;
}

void RobotOnBus::drive() {
  if (!drive_.accept(command_)) {
    throw std::logic_error("a command that is not finite got past the checks");
  }
}

void RobotOnBus::advance(std::int64_t tick) {
  const auto begin = Clock::now();
  try {
    arm_.advance(drive_.applied().tau, static_cast<double>(tick + 1) * scenario_.loop.period_s);
  } catch (const std::runtime_error& problem) {
    throw app::Failure(
        app::ExitCode::protective_stop,
        "the simulation failed at tick " + std::to_string(tick) + ": " + problem.what() +
            "; a loop that is unstable at this period ends like this (docs/laws tells "
            "the limit)");
  }
  session_.statistics().work.add(Clock::now() - begin);
}

void RobotOnBus::brake() {
  drive_.stop();
  arm_.brake(protective_stop_damping(scenario_, model_, arm_.state().q));
}

bool RobotOnBus::at_rest() const {
  constexpr double standstill = 1e-3;  // [rad/s; m/s]
  const ArmState& state = arm_.state();
  return (state.v.array().abs() < standstill).all() &&
         (state.thetadot.array().abs() < standstill).all();
}

app::Failure RobotOnBus::two_commanders(std::int64_t tick, std::string_view first,
                                        std::string_view second) const {
  return {app::ExitCode::protocol_violated,
          "two processes command run " + std::to_string(session_.run()) + ": " +
              std::string(first) + " and " + std::string(second) +
              " sent different commands for tick " + std::to_string(tick) +
              "; this run's controller is " + session_.describe(bus::Role::controller) +
              ", end the other"};
}

}  // namespace plant

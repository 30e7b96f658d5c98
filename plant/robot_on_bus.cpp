#include "plant/robot_on_bus.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <stdexcept>

#include "diagnostics/version.h"
#include "loop/measurements.h"
#include "plant/emulated_robot.h"
#include "plant/plant_model.h"

namespace tachless::plant {
namespace {

using loop::Clock;

loop::Layout layout_of(const experiment::Scenario& scenario) {
  return loop::layout(scenario.num_joints, scenario.robot.flexible.has_value());
}

}  // namespace

/// What the emulator adds to its readings, a real robot's have already.
experiment::Scenario with_ideal_encoders(experiment::Scenario scenario) {
  const EncoderSide side = scenario.plant.encoder.side;
  scenario.plant.encoder = {};
  scenario.plant.encoder.side = side;
  return scenario;
}

bool all_finite(const ArmState& state) {
  return state.q.allFinite() && state.v.allFinite() && state.theta.allFinite() &&
         state.thetadot.allFinite();
}

std::string number(double value) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.6g", value);
  return text.data();
}

RobotOnBus::RobotOnBus(const experiment::Scenario& scenario, node::Session& session,
                       RobotDriver* driver)
    : scenario_(scenario),
      session_(session),
      model_(plant_model(scenario)),
      emulator_(driver == nullptr ? std::make_unique<EmulatedRobot>(scenario_, model_) : nullptr),
      driver_(driver == nullptr ? *emulator_ : *driver),
      encoder_(driver == nullptr ? scenario : with_ideal_encoders(scenario), model_),
      drive_(make_drive(scenario, model_)),
      layout_(layout_of(scenario)),
      tick_channel_(loop::channel<loop::Tick>(scenario.robot.channel_prefix)),
      command_channel_(loop::channel<loop::TorqueCommand>(scenario.robot.channel_prefix)),
      truth_channel_(loop::channel<loop::truth::PlantTruth>(scenario.robot.channel_prefix)),
      run_info_channel_(loop::channel<loop::RunInfo>(scenario.robot.channel_prefix)),
      ack_channel_(loop::channel<loop::LogAck>(scenario.robot.channel_prefix)),
      tick_codec_(layout_),
      command_codec_(layout_),
      truth_codec_(layout_),
      ack_codec_(layout_) {
  const auto& limit = scenario.plant.drive.torque_limit_Nm;
  if (driver != nullptr && (!limit || !limit->allFinite())) {
    throw scenario.complaint("plant.drive.torque_limit_Nm",
                             "no limit; a real robot needs one for each joint");
  }
  session_.statistics().saturated_ticks.assign(static_cast<std::size_t>(scenario.num_joints), 0);
}

void RobotOnBus::prepare() {
  if (!driver_.measures_velocity() && loop::measures_velocity(session_.measurement())) {
    throw scenario_.complaint("controller.law", scenario_.controller.law +
                                                    " measures velocity, this robot does not; "
                                                    "take a law that is fed with positions");
  }
  measurement_ = make_measurement_source(session_.measurement(), scenario_, encoder_, layout_);
  measurement_channel_ = measurement_->channel();

  loop::RunInfo info;
  info.num_ticks = scenario_.loop.num_ticks;
  info.period_s = scenario_.loop.period_s;
  info.version = diagnostics::version;
  info.robot = scenario_.robot.channel_prefix;
  info.measurement = session_.measurement();
  info.signals = session_.signals();
  info.scenario = scenario_.text;
  info.robot_description = scenario_.robot.urdf_text;
  try {
    bus::Codec<loop::RunInfo> codec(layout_);
    const auto bytes = codec.encode({0, session_.run(), -1}, info);
    run_info_.assign(bytes.begin(), bytes.end());
  } catch (const std::length_error&) {
    throw diagnostics::Failure(
        diagnostics::ExitCode::bad_usage,
        scenario_.source + ": scenario and URDF have " +
            std::to_string(info.scenario.size() + info.robot_description.size()) +
            " characters together; allowed: about " +
            std::to_string(loop::max_run_info_size - 200) +
            ", for a log holds them in one message");
  }
}

loop::Stamp RobotOnBus::stamp(std::int64_t tick) const {
  const double time_s = static_cast<double>(tick) * scenario_.loop.period_s;
  return {std::llround(time_s * 1e6), session_.run(), tick};
}

void RobotOnBus::start() {
  if (!emulator_) {
    read(-1);
    const robot::Vector begin = initial_state(scenario_, model_).q;
    for (Eigen::Index i = 0; i < begin.size(); ++i) {
      if (std::abs(state_.q[i] - begin[i]) <= start_tolerance) continue;
      throw scenario_.complaint("plant.initial.position_rad",
                                number(begin[i]) + " for joint " + std::to_string(i + 1) +
                                    ", which is at " + number(state_.q[i]) +
                                    "; move the robot to within " + number(start_tolerance) +
                                    " of where the scenario begins, or begin where it is");
    }
  }
  started_ = true;
  driver_.start();
}

void RobotOnBus::read(std::int64_t tick) {
  state_ = driver_.read();
  if (emulator_) return;
  if (state_.q.size() != layout_.num_joints || state_.v.size() != layout_.num_joints ||
      state_.theta.size() != layout_.num_motors || state_.thetadot.size() != layout_.num_motors) {
    throw std::logic_error("the robot's driver reads other joints than the scenario has");
  }
  const auto when = [tick] {
    return tick < 0 ? std::string("before the start") : "at tick " + std::to_string(tick);
  };
  if (!all_finite(state_)) {
    throw diagnostics::Failure(
        diagnostics::ExitCode::protective_stop,
        "the robot's driver read a number that is not finite " + when() + "; see its encoders");
  }
  for (Eigen::Index i = 0; i < state_.q.size(); ++i) {
    if (state_.q[i] >= model_.lower[i] && state_.q[i] <= model_.upper[i]) continue;
    throw diagnostics::Failure(diagnostics::ExitCode::protective_stop,
                               "joint " + std::to_string(i + 1) + " (" +
                                   model_.joint_names[static_cast<std::size_t>(i)] + ") is at " +
                                   number(state_.q[i]) + " " + when() + ", outside of its range " +
                                   number(model_.lower[i]) + " to " + number(model_.upper[i]) +
                                   " in " + scenario_.robot.urdf_path);
  }
}

std::span<const std::byte> RobotOnBus::measurement(std::int64_t tick) {
  read(tick);
  return measurement_->measure(state_, stamp(tick));
}

std::span<const std::byte> RobotOnBus::tick(const loop::Stamp& stamp) {
  return tick_codec_.encode(stamp, {.last = stamp.tick + 1 == scenario_.loop.num_ticks});
}

std::span<const std::byte> RobotOnBus::truth(std::int64_t tick, loop::truth::DriveFault fault) {
  const AppliedTorque& applied = drive_.applied();
  truth_.q = state_.q;
  truth_.v = state_.v;
  truth_.theta = state_.theta;
  truth_.thetadot = state_.thetadot;
  truth_.tau = applied.tau;
  truth_.saturated = applied.saturated;
  truth_.fault = fault;
  for (int i = 0; i < scenario_.num_joints; ++i) {
    const auto joint = static_cast<std::size_t>(i);
    session_.statistics().saturated_ticks[joint] += applied.saturated[joint] ? 1 : 0;
  }
  if (!bus::all_finite(truth_)) {
    throw diagnostics::Failure(
        diagnostics::ExitCode::protective_stop,
        "the plant's state at tick " + std::to_string(tick) +
            " is not finite: the loop is unstable; compare its period with the "
            "limit in docs/laws for these gains");
  }
  return truth_codec_.encode(stamp(tick), truth_);
}

bool RobotOnBus::hear_command(const bus::Datagram& datagram, loop::Stamp& stamp) {
  const bus::Rejection rejection = command_codec_.decode(datagram.payload, stamp, command_);
  if (rejection == bus::Rejection::non_finite) {
    const loop::Stamp heard = bus::stamp_of(datagram.payload);
    if (heard.run == session_.run() && session_.is_from(loop::Role::controller, datagram.sender)) {
      session_.statistics().rejected.add(rejection);
      throw diagnostics::Failure(
          diagnostics::ExitCode::protective_stop,
          session_.describe(loop::Role::controller) +
              " commanded a torque that is not finite for tick " + std::to_string(heard.tick) +
              ": the loop is unstable, or the controller is broken; shorten "
              "loop.period_s or soften the gains (docs/laws tells the limit)");
    }
  }
  if (rejection != bus::Rejection::none) {
    session_.statistics().rejected.add(rejection);
  } else if (stamp.run != session_.run()) {
    session_.statistics().rejected.add(node::Discard::other_run);
  } else {
    return true;
  }
  return false;
}

bool RobotOnBus::hear_ack(const bus::Datagram& datagram, loop::Stamp& stamp, loop::LogAck& ack) {
  return session_.accept(ack_codec_, datagram, stamp, ack);
}

bool RobotOnBus::is_command(std::span<const std::byte> payload) const {
  loop::Stamp stamp;
  loop::TorqueCommand command;
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
  const double end_s = static_cast<double>(tick + 1) * scenario_.loop.period_s;
  try {
    if (stopped_) {
      driver_.rest(end_s);
    } else {
      driver_.hold(drive_.applied().tau, end_s);
    }
  } catch (const diagnostics::Failure&) {
    throw;
  } catch (const std::runtime_error& problem) {
    if (!emulator_) throw;
    throw diagnostics::Failure(
        diagnostics::ExitCode::protective_stop,
        "the simulation failed at tick " + std::to_string(tick) + ": " + problem.what() +
            "; a loop that is unstable at this period ends like this (docs/laws tells "
            "the limit)");
  }
  session_.statistics().work.add(Clock::now() - begin);
}

void RobotOnBus::stop() {
  if (stopped_) return;
  stopped_ = true;
  drive_.stop();
  if (started_) driver_.stop();
}

bool RobotOnBus::at_rest() const {
  constexpr double standstill = 1e-3;  // [rad/s; m/s]
  return (state_.v.array().abs() < standstill).all() &&
         (state_.thetadot.array().abs() < standstill).all();
}

diagnostics::Failure RobotOnBus::two_commanders(std::int64_t tick, std::string_view first,
                                                std::string_view second) const {
  return {diagnostics::ExitCode::protocol_violated,
          "two processes command run " + std::to_string(session_.run()) + ": " +
              std::string(first) + " and " + std::string(second) +
              " sent different commands for tick " + std::to_string(tick) +
              "; this run's controller is " + session_.describe(loop::Role::controller) +
              ", end the other"};
}

}  // namespace tachless::plant

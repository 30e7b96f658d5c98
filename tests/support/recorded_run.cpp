#include "tests/support/recorded_run.h"

#include <cmath>
#include <random>

#include "messages/truth/truth_wire.h"
#include "tests/support/damaged_log.h"

namespace tachless::logger {
namespace {

template <class Value>
Recorded message(const messages::Layout& layout, const std::string& channel,
                 const messages::Stamp& stamp, const Value& value) {
  messages::Codec<Value> codec(layout);
  const auto bytes = codec.encode(stamp, value);
  return {stamp.utime, channel, {reinterpret_cast<const char*>(bytes.data()), bytes.size()}};
}

}  // namespace

std::string log_of(const std::vector<Recorded>& messages) {
  std::string bytes;
  std::int64_t number = 0;
  for (const auto& message : messages) {
    bytes += event_text(number++, message.utime, message.channel, message.data);
  }
  return bytes;
}

std::string RecordedRun::bytes() const { return log_of(messages); }

RecordedRun recorded_run(const std::string& scenario, const std::vector<std::string>& overrides,
                         const std::string& measurement, const std::string& signals,
                         std::int64_t run, std::uint64_t seed) {
  RecordedRun result;
  result.run = run;
  result.scenario =
      scenario::load_scenario(std::string(TACHLESS_SOURCE_DIR "/scenarios/") + scenario, overrides);
  const auto& robot = result.scenario.robot;
  const int n = result.scenario.num_joints;
  const auto num_signals = messages::parse_signals(signals).value().size();
  const auto layout =
      messages::layout(n, robot.flexible.has_value(), static_cast<int>(num_signals));
  result.info = {{result.scenario.controller.law, measurement, signals},
                 result.scenario.loop.num_ticks,
                 result.scenario.loop.period_s,
                 "0.2.0",
                 robot.channel_prefix,
                 result.scenario.text,
                 robot.urdf_text};
  const auto channel = [&](std::string_view suffix) {
    return robot.channel_prefix + "_" + std::string(suffix);
  };
  result.messages.push_back(
      message(layout, channel("RUN_INFO"), messages::Stamp{0, run, -1}, result.info));

  std::mt19937_64 random(seed);
  const auto vector = [&](int size) {
    Vector x(size);
    for (double& value : x) value = std::ldexp(static_cast<double>(random()) - 9e18, -62);
    return x;
  };
  for (std::int64_t tick = 0; tick < result.scenario.loop.num_ticks; ++tick) {
    const auto utime = static_cast<std::int64_t>(
        std::llround(static_cast<double>(tick) * result.info.period_s * 1e6));
    const messages::Stamp stamp{utime, run, tick};
    TickRecord record;
    record.tick = tick;
    const auto add = [&](std::string_view suffix, const auto& value) {
      result.messages.push_back(message(layout, channel(suffix), stamp, value));
    };
    record.clock = messages::Tick{tick + 1 == result.scenario.loop.num_ticks};
    add("TICK", *record.clock);
    const auto measure = [&](const auto& value) {
      record.measurement = value;
      add(measurement, value);
    };
    const int m = layout.num_motors;
    if (measurement == "POSITION") {
      measure(messages::PositionMeasurement{vector(n)});
    } else if (measurement == "MOTOR_POSITION") {
      measure(messages::MotorPositionMeasurement{vector(n)});
    } else if (measurement == "BOTH_POSITIONS") {
      measure(messages::BothPositionsMeasurement{vector(n), vector(n)});
    } else if (measurement == "LINK_STATE") {
      measure(messages::LinkStateMeasurement{vector(n), vector(n), vector(n)});
    } else {
      measure(messages::StateMeasurement{vector(n), vector(n), vector(m), vector(m)});
    }
    record.reference =
        messages::ReferencePoint{vector(n), vector(n), vector(n), vector(n), vector(n)};
    add("REFERENCE", *record.reference);
    record.command = messages::TorqueCommand{vector(n)};
    add("COMMAND", *record.command);
    messages::LawSignals state;
    state.num = layout.num_signals;
    for (std::size_t i = 0; i < num_signals; ++i) state.value[i] = vector(n);
    record.controller_state = state;
    add("CONTROLLER_STATE", state);
    messages::truth::PlantTruth truth;
    truth.q = vector(n);
    truth.v = vector(n);
    truth.theta = vector(m);
    truth.thetadot = vector(m);
    truth.tau = vector(n);
    truth.saturated[0] = random() % 2 == 0;
    truth.fault = static_cast<messages::truth::DriveFault>(random() % 3);
    truth.disturbance = vector(n);
    record.truth = truth;
    add("TRUTH", truth);
    result.ticks.push_back(record);
  }
  return result;
}

RecordedRun short_rigid_run(std::int64_t run) {
  return recorded_run("paper_rigid.yaml", {"loop.duration_s=0.002"}, "POSITION", rigid_signals,
                      run);
}

RecordedRun short_arm_run(std::optional<messages::truth::Told> told) {
  RecordedRun run =
      recorded_run("paper_rigid.yaml", {"loop.duration_s=0.002", "loop.mode=realtime"}, "POSITION");
  const messages::Layout layout = messages::layout(2, false);
  for (std::size_t k = 0; told && k < run.ticks.size(); ++k) {
    const auto number = static_cast<double>(k);
    const messages::truth::ArmTorque torque{Vector::Constant(2, number),
                                            Vector::Constant(2, number + 0.5), *told};
    const messages::Stamp stamp{run.messages[1 + 6 * k].utime, run.run, run.ticks[k].tick};
    run.messages.push_back(message(layout, run.info.robot + "_ARM_TORQUE", stamp, torque));
    run.ticks[k].arm_torque = torque;
  }
  return run;
}

RecordedRun short_flexible_run() {
  return recorded_run("paper_flexible.yaml", {"loop.duration_s=0.0004"}, "LINK_STATE",
                      "error_1:rad,nu_1:rad/s,error_2:rad,nu_2:rad/s");
}

Recorded fault_message(const RecordedRun& run, const std::string& text) {
  messages::Participant who;
  who.role = messages::Role::controller;
  who.instance = 4;  // of a process
  who.state = messages::ParticipantState::fault;
  who.fault_code = 5;
  who.fault = text;
  return message({1, 0, 0}, run.info.robot + "_PARTICIPANT",
                 messages::Stamp{123, run.run, run.stop_tick}, who);
}

Recorded finished_message(const RecordedRun& run) {
  messages::Participant who;
  who.state = messages::ParticipantState::finished;
  return message({1, 0, 0}, run.info.robot + "_PARTICIPANT", messages::Stamp{123, run.run, 39},
                 who);
}

}  // namespace tachless::logger

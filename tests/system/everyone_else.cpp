#include "tests/system/everyone_else.h"

#include <chrono>

namespace tachless::system_test {
namespace {

constexpr loop::Layout layout{.num_joints = 2, .num_motors = 0, .num_signals = 2};

}  // namespace

EveryoneElse::EveryoneElse(const experiment::Scenario& scenario, const std::string& url)
    : scenario_(scenario),
      transport_(url),
      prefix_(scenario.robot.channel_prefix + "_"),
      participants_(layout),
      run_infos_(layout),
      ticks_(layout),
      positions_(layout),
      references_(layout),
      commands_(layout),
      states_(layout),
      truths_(layout) {
  transport_.subscribe(prefix_ + "LOG_ACK");
}

void EveryoneElse::announce(loop::ParticipantState state) {
  loop::Participant plant;
  plant.instance = 99;
  plant.scenario_digest = scenario_.digest;
  plant.state = state;
  plant.role = loop::Role::plant;
  transport_.publish(prefix_ + "PARTICIPANT", participants_.encode({0, run_id, -1}, plant));
}

void EveryoneElse::meet_the_logger() {
  loop::RunInfo info;
  info.num_ticks = scenario_.loop.num_ticks;
  info.period_s = scenario_.loop.period_s;
  info.robot = scenario_.robot.channel_prefix;
  info.measurement = "POSITION";
  info.scenario = scenario_.text;
  info.robot_description = scenario_.robot.urdf_text;
  do {
    announce(loop::ParticipantState::waiting);
    transport_.publish(prefix_ + "RUN_INFO", run_infos_.encode({0, run_id, -1}, info));
  } while (!transport_.receive(loop::Clock::now() + std::chrono::milliseconds(10)));
}

void EveryoneElse::say(std::int64_t k) {
  const robot::Vector two = robot::Vector::Zero(2);
  loop::LawSignals state;
  state.num = 2;
  state.value[0] = state.value[1] = two;
  loop::truth::PlantTruth truth;
  truth.q = truth.v = truth.tau = two;
  const loop::Stamp stamp{1000 * k, run_id, k};
  transport_.publish(prefix_ + "TICK", ticks_.encode(stamp, {}));
  transport_.publish(prefix_ + "POSITION", positions_.encode(stamp, {two}));
  transport_.publish(prefix_ + "REFERENCE", references_.encode(stamp, {two, two, two, two, two}));
  transport_.publish(prefix_ + "COMMAND", commands_.encode(stamp, {two}));
  transport_.publish(prefix_ + "CONTROLLER_STATE", states_.encode(stamp, state));
  transport_.publish(prefix_ + "TRUTH", truths_.encode(stamp, truth));
}

}  // namespace tachless::system_test

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
  transport_.subscribe(prefix_ + "PARTICIPANT");
  for (const loop::Role role : {loop::Role::plant, loop::Role::reference, loop::Role::controller}) {
    protocol::Membership::Self self;
    self.who.role = role;
    self.who.instance = 99 + static_cast<int>(role);
    self.who.scenario_digest = scenario.digest;
    if (role == loop::Role::plant) self.run = run_id;
    if (role == loop::Role::controller) self.who.measurement = "POSITION";
    members_.emplace_back(self, loop::Clock::now());
  }
}

void EveryoneElse::publish(protocol::Membership& member) {
  const auto now = loop::Clock::now();
  const auto& said = member.announce(now);
  transport_.publish(prefix_ + "PARTICIPANT", participants_.encode(said.stamp, said.participant));
  for (protocol::Membership& other : members_) {
    if (&other != &member) other.handle(said.stamp, said.participant, "everyone else", now);
  }
}

/// The members hear what the logger announces. @return whether it has acknowledged something
bool EveryoneElse::handle_until(loop::Clock::time_point deadline) {
  bool acknowledged = false;
  while (const auto datagram = transport_.receive(deadline)) {
    loop::Stamp stamp;
    loop::Participant logger;
    if (datagram->channel.ends_with("LOG_ACK")) acknowledged = true;
    if (participants_.decode(datagram->payload, stamp, logger) != bus::Rejection::none) continue;
    for (protocol::Membership& each : members_) {
      each.handle(stamp, logger, datagram->sender, loop::Clock::now());
    }
  }
  return acknowledged;
}

void EveryoneElse::announce(loop::ParticipantState state) {
  handle_until(loop::Clock::time_point());
  protocol::Membership& plant = members_.front();
  if (state == loop::ParticipantState::finished) plant.finished(loop::Clock::now());
  publish(plant);
}

void EveryoneElse::meet_the_logger() {
  loop::RunInfo info;
  info.num_ticks = scenario_.loop.num_ticks;
  info.period_s = scenario_.loop.period_s;
  info.robot = scenario_.robot.channel_prefix;
  info.measurement = "POSITION";
  info.scenario = scenario_.text;
  info.robot_description = scenario_.robot.urdf_text;
  protocol::Membership& plant = members_.front();
  do {
    for (protocol::Membership& each : members_) publish(each);
    if (plant.joined()) {
      plant.started(loop::Clock::now());
      transport_.publish(prefix_ + "RUN_INFO", run_infos_.encode({0, run_id, -1}, info));
    }
  } while (!handle_until(loop::Clock::now() + std::chrono::milliseconds(10)));
}

void EveryoneElse::say(std::int64_t k) {
  const robot::Vector two = robot::Vector::Zero(2);
  loop::LawSignals state;
  state.num = 2;
  state.value[0] = state.value[1] = two;
  loop::truth::PlantTruth truth;
  truth.q = truth.v = truth.tau = truth.disturbance = two;
  const loop::Stamp stamp{1000 * k, run_id, k};
  transport_.publish(prefix_ + "TICK", ticks_.encode(stamp, {}));
  transport_.publish(prefix_ + "POSITION", positions_.encode(stamp, {two}));
  transport_.publish(prefix_ + "REFERENCE", references_.encode(stamp, {two, two, two, two, two}));
  transport_.publish(prefix_ + "COMMAND", commands_.encode(stamp, {two}));
  transport_.publish(prefix_ + "CONTROLLER_STATE", states_.encode(stamp, state));
  transport_.publish(prefix_ + "TRUTH", truths_.encode(stamp, truth));
}

}  // namespace tachless::system_test

#include "plant/plant_messages.h"

#include <fmt/core.h>

#include <cmath>

#include "diagnostics/logging.h"
#include "loop/measurements.h"
#include "plant/run_info.h"
#include "plant/truth_of.h"

namespace tachless::plant {
namespace {

using diagnostics::ExitCode;
using diagnostics::Failure;

/// What the emulator adds to its readings, a real robot's have already.
experiment::Scenario with_ideal_encoders(experiment::Scenario scenario) {
  const EncoderSide side = scenario.plant.encoder.side;
  scenario.plant.encoder = {};
  scenario.plant.encoder.side = side;
  return scenario;
}

template <class Value>
PlantMessages::Port port(const experiment::Scenario& scenario, std::size_t longest = 0) {
  return {loop::channel<Value>(scenario.robot.channel_prefix), longest};
}

}  // namespace

PlantMessages::PlantMessages(const experiment::Scenario& scenario, const GuardedRobot& robot,
                             node::Link& link)
    : scenario_(scenario),
      robot_(robot),
      link_(link),
      encoder_(robot.emulated() ? scenario : with_ideal_encoders(scenario), robot.model()),
      layout_(loop::layout(scenario.num_joints, scenario.robot.flexible.has_value())),
      tick_codec_(layout_),
      command_codec_(layout_),
      truth_codec_(layout_),
      ack_codec_(layout_),
      tick_port_(port<loop::Tick>(scenario, tick_codec_.longest())),
      command_port_(port<loop::TorqueCommand>(scenario, command_codec_.longest())),
      truth_port_(port<loop::truth::PlantTruth>(scenario, truth_codec_.longest())),
      run_info_port_(port<loop::RunInfo>(scenario)),
      ack_port_(port<loop::LogAck>(scenario, ack_codec_.longest())) {
  const auto num_joints = static_cast<std::size_t>(scenario.num_joints);
  link_.statistics().plant().saturated_ticks.assign(num_joints, 0);
  link_.statistics().plant().beyond_limit_ticks.assign(num_joints, 0);
}

namespace {

/// Whether the controller that came is the one that the scenario speaks of.
void require_the_scenarios(const loop::LawInfo& law, const experiment::Scenario& scenario) {
  const experiment::ControllerSpec& spec = scenario.controller;
  const bool external = spec.law == experiment::external_law;
  if (!external && law.name != spec.law) {
    throw scenario.complaint("controller.law",
                             fmt::format("{}, but the controller that came runs the law \"{}\"; "
                                         "for a law of your own, write law: {}",
                                         spec.law, law.name, experiment::external_law));
  }
  if (external && law.measurement != spec.measurement) {
    throw scenario.complaint("controller.measurement",
                             fmt::format("{}, but the controller that came needs \"{}\"",
                                         spec.measurement, law.measurement));
  }
}

}  // namespace

void PlantMessages::prepare() {
  const loop::LawInfo law = link_.membership().law();
  require_the_scenarios(law, scenario_);
  const std::string& needed = law.measurement;
  if (!robot_.measures_velocity() && loop::measures_velocity(needed)) {
    throw scenario_.complaint(
        "controller.law",
        fmt::format(
            "{} measures velocity, this robot does not; take a law that is fed with positions",
            scenario_.controller.law));
  }
  measurement_ = make_measurement_source(needed, scenario_, encoder_, layout_);
  measurement_port_ = {measurement_->channel(), measurement_->longest()};
  diagnostics::log_detail("the law measures {}", needed);

  run_info_ = plant::run_info(scenario_, link_.run(), law);
}

loop::Stamp PlantMessages::stamp(std::int64_t tick) const {
  const double time_s = static_cast<double>(tick) * scenario_.loop.period_s;
  return {std::llround(time_s * 1e6), link_.run(), tick};
}

std::span<const std::byte> PlantMessages::measurement(std::int64_t tick) {
  return measurement_->measure(robot_.sensed(), stamp(tick));
}

std::span<const std::byte> PlantMessages::tick(const loop::Stamp& stamp) {
  return tick_codec_.encode(stamp, {.last = stamp.tick + 1 == scenario_.loop.num_ticks});
}

std::span<const std::byte> PlantMessages::truth(std::int64_t tick, loop::truth::DriveFault fault) {
  const AppliedTorque& applied = robot_.applied();
  truth_ = truth_of(robot_.state(), applied);
  truth_.fault = fault;
  node::PlantStatistics& statistics = link_.statistics().plant();
  for (int i = 0; i < scenario_.num_joints; ++i) {
    const auto joint = static_cast<std::size_t>(i);
    statistics.saturated_ticks[joint] += applied.saturated[joint] ? 1 : 0;
    statistics.beyond_limit_ticks[joint] += robot_.beyond_limit()[joint] ? 1 : 0;
  }
  if (!bus::all_finite(truth_)) throw not_finite(tick);
  return truth_codec_.encode(stamp(tick), truth_);
}

bool PlantMessages::accept_command(const bus::Datagram& datagram, loop::Stamp& stamp) {
  const bus::Rejection rejection = command_codec_.decode(datagram.payload, stamp, command_);
  if (rejection == bus::Rejection::non_finite) {
    const loop::Stamp heard = bus::stamp_of(datagram.payload);
    if (heard.run == link_.run() && link_.is_from(loop::Role::controller, datagram.sender)) {
      link_.statistics().rejected.add(rejection);
      throw Failure(ExitCode::protective_stop,
                    "{} commanded a torque that is not finite for tick {}: the loop is unstable, "
                    "or the controller is broken; shorten loop.period_s or soften the gains",
                    link_.describe(loop::Role::controller), heard.tick);
    }
  }
  return link_.accept(rejection, stamp);
}

bool PlantMessages::accept_ack(const bus::Datagram& datagram, loop::Stamp& stamp,
                               loop::LogAck& ack) {
  if (!link_.accept(ack_codec_, datagram, stamp, ack)) return false;
  if (link_.is_from(loop::Role::logger, datagram.sender)) return true;
  link_.statistics().rejected.add(node::Discard::other_sender);
  return false;
}

bool PlantMessages::is_command(std::span<const std::byte> payload) const {
  loop::Stamp stamp;
  loop::TorqueCommand command;
  const bus::Rejection rejection = command_codec_.decode(payload, stamp, command);
  return rejection == bus::Rejection::none || rejection == bus::Rejection::non_finite;
}

}  // namespace tachless::plant

#include "plant/plant_loop.h"

#include <cmath>

#include "diagnostics/failure.h"
#include "diagnostics/logging.h"
#include "node/run_info.h"
#include "plant/node.h"
#include "plant/run_messages.h"

namespace tachless::plant {
namespace {

using diagnostics::ExitCode;
using diagnostics::Failure;

}  // namespace

PlantLoop::PlantLoop(const experiment::Scenario& scenario, node::Link& link, RobotDriver* driver)
    : scenario_(scenario),
      link_(link),
      robot_(scenario, driver),
      prefix_(scenario.robot.channel_prefix),
      layout_(loop::layout(scenario.num_joints, scenario.robot.flexible.has_value())),
      tick_port_(bus::port<loop::Tick>(prefix_, layout_)),
      command_port_(bus::port<loop::TorqueCommand>(prefix_, layout_)),
      truth_port_(bus::port<loop::truth::PlantTruth>(prefix_, layout_)) {
  const auto num_joints = static_cast<std::size_t>(scenario.num_joints);
  link_.statistics().plant().saturated_ticks.assign(num_joints, 0);
  link_.statistics().plant().beyond_limit_ticks.assign(num_joints, 0);
  link_.statistics().plant().robot_is_clock = robot_.is_clock();
}

void PlantLoop::prepare() {
  const loop::LawInfo law = link_.membership().law();
  scenario_.require_law(law);
  robot_.feed(law.measurement);
  measurement_port_.emplace(bus::Port<loop::AnyMeasurement>{loop::channel(prefix_, law.measurement),
                                                            {law.measurement, layout_}});
  diagnostics::log_detail("the law measures {}", law.measurement);
  link_.transport().publish(loop::channel<loop::RunInfo>(prefix_),
                            node::run_info(scenario_, link_.run(), law));
}

loop::Stamp PlantLoop::stamp(std::int64_t tick) const {
  const double time_s = static_cast<double>(tick) * scenario_.loop.period_s;
  return {std::llround(time_s * 1e6), link_.run(), tick};
}

PlantLoop::Request PlantLoop::publish_request(const loop::Stamp& tick_stamp) {
  const std::int64_t k = tick_stamp.tick;
  robot_.read(k);
  Request request;
  request.measurement = measurement_port_->codec.encode(stamp(k), robot_.measure(k));
  request.sent = loop::Clock::now();
  // First: the command waits for it.
  link_.transport().publish(measurement_port_->channel, request.measurement);
  request.tick = tick_port_.codec.encode(tick_stamp, {.last = k + 1 == scenario_.loop.num_ticks});
  link_.transport().publish(tick_port_.channel, request.tick);
  return request;
}

PlantLoop::Bytes PlantLoop::publish_truth(std::int64_t tick, loop::truth::DriveFault fault) {
  const AppliedTorque& applied = robot_.applied();
  loop::truth::PlantTruth truth = truth_of(robot_.state(), applied);
  truth.fault = fault;
  node::PlantStatistics& statistics = link_.statistics().plant();
  for (std::size_t joint = 0; joint < statistics.saturated_ticks.size(); ++joint) {
    statistics.saturated_ticks[joint] += applied.saturated[joint] ? 1 : 0;
    statistics.beyond_limit_ticks[joint] += robot_.beyond_limit()[joint] ? 1 : 0;
  }
  if (!bus::all_finite(truth)) throw not_finite(tick);
  const Bytes bytes = truth_port_.codec.encode(stamp(tick), truth);
  link_.transport().publish(truth_port_.channel, bytes);
  return bytes;
}

void PlantLoop::completed(std::int64_t tick) {
  link_.progressed(tick);
  link_.statistics().ticks = tick + 1;
}

bool PlantLoop::accept_command(const bus::Datagram& datagram, loop::Stamp& stamp) {
  const bus::Rejection rejection = command_port_.codec.decode(datagram.payload, stamp, command_);
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

void run_node(const experiment::Scenario& scenario, node::Link& link) {
  if (scenario.loop.mode == experiment::Mode::realtime) {
    run_realtime(scenario, link, nullptr);
  } else {
    run_lockstep(scenario, link);
  }
}

void run_driver(const experiment::Scenario& scenario, node::Link& link, RobotDriver& driver) {
  if (scenario.loop.mode != experiment::Mode::realtime) {
    throw scenario.complaint("loop.mode",
                             "lockstep; a real robot does not wait, so only realtime is allowed");
  }
  run_realtime(scenario, link, &driver);
}

}  // namespace tachless::plant

#include "plant/plant_loop.h"

#include <cmath>

#include "base/failure.h"
#include "base/logging.h"
#include "plant/node.h"
#include "plant/run_messages.h"
#include "session/run_info.h"

namespace tachless::plant {
namespace {

using base::ExitCode;
using base::Failure;

}  // namespace

PlantLoop::PlantLoop(const scenario::Scenario& scenario, session::Link& link, RobotDriver* driver)
    : scenario_(scenario),
      link_(link),
      robot_(scenario, driver),
      prefix_(scenario.robot.channel_prefix),
      layout_(messages::layout(scenario.num_joints, scenario.robot.flexible.has_value())),
      tick_port_(messages::port<messages::Tick>(prefix_, layout_)),
      command_port_(messages::port<messages::TorqueCommand>(prefix_, layout_)),
      truth_port_(messages::port<messages::truth::PlantTruth>(prefix_, layout_)) {
  const auto num_joints = static_cast<std::size_t>(scenario.num_joints);
  link_.statistics().plant().saturated_ticks.assign(num_joints, 0);
  link_.statistics().plant().beyond_limit_ticks.assign(num_joints, 0);
  link_.statistics().plant().robot_is_clock = robot_.is_clock();
}

void PlantLoop::prepare() {
  const messages::LawInfo law = link_.membership().law();
  scenario_.require_law(law);
  robot_.feed(law.measurement);
  measurement_port_.emplace(messages::Port<messages::AnyMeasurement>{
      messages::channel(prefix_, law.measurement), {law.measurement, layout_}});
  base::log_detail("the law measures {}", law.measurement);
  link_.transport().publish(messages::channel<messages::RunInfo>(prefix_),
                            session::run_info(scenario_, link_.run(), law));
}

messages::Stamp PlantLoop::stamp(std::int64_t tick) const {
  const double time_s = static_cast<double>(tick) * scenario_.loop.period_s;
  return {std::llround(time_s * 1e6), link_.run(), tick};
}

PlantLoop::Request PlantLoop::publish_request(const messages::Stamp& tick_stamp) {
  const std::int64_t k = tick_stamp.tick;
  robot_.read(k);
  Request request;
  request.measurement = measurement_port_->codec.encode(stamp(k), robot_.measure(k));
  request.sent = base::Clock::now();
  // First: the command waits for it.
  link_.transport().publish(measurement_port_->channel, request.measurement);
  request.tick = tick_port_.codec.encode(tick_stamp, {.last = k + 1 == scenario_.loop.num_ticks});
  link_.transport().publish(tick_port_.channel, request.tick);
  return request;
}

PlantLoop::Bytes PlantLoop::publish_truth(std::int64_t tick, messages::truth::DriveFault fault) {
  const AppliedTorque& applied = robot_.applied();
  messages::truth::PlantTruth truth = truth_of(robot_.state(), applied);
  truth.fault = fault;
  session::PlantStatistics& statistics = link_.statistics().plant();
  for (std::size_t joint = 0; joint < statistics.saturated_ticks.size(); ++joint) {
    statistics.saturated_ticks[joint] += applied.saturated[joint] ? 1 : 0;
    statistics.beyond_limit_ticks[joint] += robot_.beyond_limit()[joint] ? 1 : 0;
  }
  if (!messages::all_finite(truth)) throw not_finite(tick);
  const Bytes bytes = truth_port_.codec.encode(stamp(tick), truth);
  link_.transport().publish(truth_port_.channel, bytes);
  return bytes;
}

void PlantLoop::completed(std::int64_t tick) {
  link_.progressed(tick);
  link_.statistics().ticks = tick + 1;
}

bool PlantLoop::accept_command(const bus::Datagram& datagram, messages::Stamp& stamp) {
  const messages::Rejection rejection =
      command_port_.codec.decode(datagram.payload, stamp, command_);
  if (rejection == messages::Rejection::non_finite) {
    const messages::Stamp heard = messages::stamp_of(datagram.payload);
    if (heard.run == link_.run() && link_.is_from(messages::Role::controller, datagram.sender)) {
      link_.statistics().rejected.add(rejection);
      throw Failure(ExitCode::protective_stop,
                    "{} commanded a torque that is not finite for tick {}: the loop is unstable, "
                    "or the controller is broken; shorten loop.period_s or soften the gains",
                    link_.describe(messages::Role::controller), heard.tick);
    }
  }
  return link_.accept(rejection, stamp);
}

void run_node(const scenario::Scenario& scenario, session::Link& link) {
  if (scenario.loop.mode == scenario::Mode::realtime) {
    run_realtime(scenario, link, nullptr);
  } else {
    run_lockstep(scenario, link);
  }
}

void run_driver(const scenario::Scenario& scenario, session::Link& link, RobotDriver& driver) {
  if (scenario.loop.mode != scenario::Mode::realtime) {
    throw scenario.complaint("loop.mode",
                             "lockstep; a real robot does not wait, so only realtime is allowed");
  }
  run_realtime(scenario, link, &driver);
}

}  // namespace tachless::plant

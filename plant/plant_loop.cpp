#include "plant/plant_loop.h"

#include <cmath>
#include <exception>

#include "base/failure.h"
#include "base/logging.h"
#include "plant/node.h"
#include "plant/truth_of.h"
#include "session/options.h"
#include "session/run_info.h"
#include "session/run_role.h"

namespace tachless::plant {
namespace {

using base::ExitCode;
using base::Failure;

void run_emulated(const scenario::Scenario& scenario, session::Session& session,
                  Simulator* simulator) {
  if (scenario.loop.mode == scenario::Mode::realtime) {
    run_realtime(scenario, session, nullptr, simulator);
  } else {
    run_lockstep(scenario, session, simulator);
  }
}

/// @throw Failure(bad_usage) in lock-step
void require_realtime(const scenario::Scenario& scenario) {
  if (scenario.loop.mode == scenario::Mode::realtime) return;
  throw scenario.complaint("loop.mode",
                           "lockstep; a real robot does not wait, so only realtime is allowed");
}

/// Returns what `make` makes. Nothing has moved yet: whatever it throws is bad usage.
std::unique_ptr<RobotDriver> made_driver(const scenario::Scenario& scenario,
                                         const MakeDriver& make) {
  try {
    return make(scenario);
  } catch (const Failure&) {
    throw;
  } catch (const std::exception& thrown) {
    throw base::bad_usage("the driver threw: {}", thrown.what());
  } catch (...) {
    throw base::bad_usage("the driver threw an exception that is no std::exception");
  }
}

}  // namespace

PlantLoop::PlantLoop(const scenario::Scenario& scenario, session::Session& session,
                     RobotDriver* driver, Simulator* simulator)
    : scenario_(scenario),
      session_(session),
      robot_(scenario, driver, simulator),
      prefix_(scenario.robot.channel_prefix),
      layout_(messages::layout(scenario.num_joints, scenario.robot.flexible.has_value())),
      tick_port_(messages::port<messages::Tick>(prefix_, layout_)),
      command_port_(messages::port<messages::TorqueCommand>(prefix_, layout_)),
      truth_port_(messages::port<messages::truth::PlantTruth>(prefix_, layout_)),
      arm_torque_port_(messages::port<messages::truth::ArmTorque>(prefix_, layout_)) {
  const auto num_joints = static_cast<std::size_t>(scenario.num_joints);
  session_.statistics().plant().saturated_ticks.assign(num_joints, 0);
  session_.statistics().plant().beyond_limit_ticks.assign(num_joints, 0);
  session_.statistics().plant().robot_is_clock = robot_.is_clock();
  if (!scenario.plant.mujoco.model.empty()) {
    contact_port_.emplace(messages::port<messages::truth::Contact>(prefix_, layout_));
  }
}

void PlantLoop::prepare() {
  const messages::LawInfo law = session_.membership().law();
  scenario_.require_law(law);
  robot_.feed(law.measurement);
  measurement_port_.emplace(messages::Port<messages::AnyMeasurement>{
      messages::channel(prefix_, law.measurement), {law.measurement, layout_}});
  base::log_detail("the law measures {}", law.measurement);
  session_.publish(messages::channel<messages::RunInfo>(prefix_),
                   session::run_info(scenario_, session_.run(), law));
}

messages::Stamp PlantLoop::stamp(std::int64_t tick) const {
  const double time_s = static_cast<double>(tick) * scenario_.loop.period_s;
  return {std::llround(time_s * 1e6), session_.run(), tick};
}

PlantLoop::Request PlantLoop::publish_request(const messages::Stamp& tick_stamp) {
  const std::int64_t k = tick_stamp.tick;
  Request request;
  request.sent = base::Clock::now();
  if (robot_.has_reading()) {
    const messages::AnyMeasurement& measurement = robot_.measure(k);
    request.sent = base::Clock::now();
    // The command waits for the measurement, which is published first.
    request.measurement = session_.publish(*measurement_port_, stamp(k), measurement);
  }
  request.tick = session_.publish(tick_port_, tick_stamp,
                                  messages::Tick{.last = k + 1 == scenario_.loop.num_ticks});
  return request;
}

PlantLoop::Truth PlantLoop::publish_truth(std::int64_t tick, messages::truth::DriveFault fault) {
  const AppliedTorque& applied = robot_.applied();
  messages::truth::PlantTruth truth = truth_of(robot_.state(), applied);
  truth.fault = fault;
  session::PlantStatistics& statistics = session_.statistics().plant();
  for (std::size_t joint = 0; joint < statistics.saturated_ticks.size(); ++joint) {
    statistics.saturated_ticks[joint] += applied.saturated[joint] ? 1 : 0;
    statistics.beyond_limit_ticks[joint] += robot_.beyond_limit()[joint] ? 1 : 0;
  }
  if (!robot_.has_reading()) return {};
  if (!messages::all_finite(truth)) throw not_finite(tick);
  Truth published;
  if (contact_port_) {
    published.contact = session_.publish(*contact_port_, stamp(tick), contact_of(robot_.state()));
  }
  if (const auto told = arm_torque_of(robot_.state())) {
    session_.publish(arm_torque_port_, stamp(tick), *told);
  }
  published.truth = session_.publish(truth_port_, stamp(tick), truth);
  return published;
}

void PlantLoop::note_completed(std::int64_t tick) {
  session_.note_progress(tick);
  session_.statistics().ticks = tick + 1;
}

void PlantLoop::require_finite(messages::Rejection rejection, const bus::Datagram& command) const {
  if (rejection != messages::Rejection::non_finite) return;
  const messages::Stamp stamp = messages::stamp_of(command.payload);
  if (stamp.run != session_.run()) return;
  if (!session_.is_from(messages::Role::controller, command.sender)) return;
  session_.statistics().rejected.add(rejection);
  throw Failure(ExitCode::protective_stop,
                "{} commanded a torque that is not finite for tick {}: the loop is unstable, "
                "or the controller is broken; shorten loop.period_s or soften the gains",
                session_.describe(messages::Role::controller), stamp.tick);
}

void run_node(const scenario::Scenario& scenario, session::Session& session) {
  run_emulated(scenario, session, nullptr);
}

void run_simulator(const scenario::Scenario& scenario, session::Session& session,
                   Simulator& simulator) {
  run_emulated(scenario, session, &simulator);
}

void run_driver(const scenario::Scenario& scenario, session::Session& session,
                RobotDriver& driver) {
  require_realtime(scenario);
  // The caller's driver may end before the session.
  const struct EndOfRest {
    session::Session& session;
    ~EndOfRest() { session.while_attending({}, {}); }
  } end_of_rest{session};
  run_realtime(scenario, session, &driver, nullptr);
}

int driver_program(int argc, const char* const* argv, const MakeDriver& make) {
  constexpr auto role = messages::Role::plant;
  return session::run_process(role, argc, argv, [&](const session::ProcessOptions& options) {
    std::unique_ptr<RobotDriver> driver;  // outlives the session, which lets it rest
    return session::run_role(role, options,
                             [&](const scenario::Scenario& scenario, session::Session& session) {
                               require_realtime(scenario);
                               driver = made_driver(scenario, make);
                               run_realtime(scenario, session, driver.get(), nullptr);
                             });
  });
}

}  // namespace tachless::plant

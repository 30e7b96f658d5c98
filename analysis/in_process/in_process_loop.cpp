#include "in_process/in_process_loop.h"

#include <utility>

#include "plant/guarded_robot.h"
#include "reference/make_trajectory.h"

namespace tachless::in_process {
namespace {

void step_loop(plant::GuardedRobot& robot, const scenario::Scenario& scenario,
               controller::ScenarioLaw law, const std::function<bool(const TickRecord&)>& on_tick) {
  robot.feed(law->measurement());
  const reference::Trajectory trajectory = reference::make_trajectory(scenario);
  robot.start();
  TickRecord record;
  for (std::int64_t k = 0; k < scenario.loop.num_ticks; ++k) {
    record.tick = k;
    record.time_s = static_cast<double>(k) * scenario.loop.period_s;
    record.truth = robot.read(k);
    if (!all_finite(record.truth)) throw plant::not_finite(k);
    record.beyond_limit = robot.beyond_limit();
    record.measurement = robot.measure(k);
    record.reference = trajectory.at(record.time_s);

    const controller::Outcome step = law->step(k, record.measurement, record.reference);
    record.command = step.command;
    record.controller = step.signals;

    robot.accept(record.command);
    record.applied = robot.applied();
    robot.advance(k);
    robot.end_tick();
    if (!on_tick(record)) break;
  }
}

}  // namespace

void run_in_process(const scenario::Scenario& scenario, controller::ScenarioLaw law,
                    const std::function<bool(const TickRecord&)>& on_tick,
                    plant::RobotDriver* driver) {
  plant::GuardedRobot robot(scenario, driver);
  step_loop(robot, scenario, std::move(law), on_tick);
}

void run_in_process(const scenario::Scenario& scenario, controller::ScenarioLaw law,
                    const std::function<bool(const TickRecord&)>& on_tick,
                    plant::Simulator& simulator) {
  plant::GuardedRobot robot(scenario, nullptr, &simulator);
  step_loop(robot, scenario, std::move(law), on_tick);
}

void run_in_process(const scenario::Scenario& scenario,
                    const std::function<bool(const TickRecord&)>& on_tick) {
  run_in_process(scenario, controller::scenario_law(scenario), on_tick);
}

}  // namespace tachless::in_process

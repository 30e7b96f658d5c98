#include "study/in_process_loop.h"

#include <fmt/format.h>

#include <algorithm>
#include <string_view>
#include <utility>
#include <vector>

#include "diagnostics/failure.h"
#include "plant/guarded_robot.h"
#include "reference/make_trajectory.h"

namespace tachless::study {
namespace {

constexpr double finest_accuracy = 1e-12;

/// Largest difference, of values above 1 relative to them; 0 of what a rigid robot has not.
double distance(const robot::Vector& got, const robot::Vector& expected) {
  if (got.size() == 0) return 0;
  const robot::Vector scale = expected.cwiseAbs().cwiseMax(1.0);
  return (got - expected).cwiseQuotient(scale).cwiseAbs().maxCoeff();
}

/// The scenario with that mechanics.
experiment::Scenario moved_by(std::string_view mechanics, const experiment::Scenario& scenario) {
  const double accuracy = std::min(scenario.plant.integrator.accuracy, finest_accuracy);
  return experiment::parse_scenario(
      scenario.text, scenario.robot.urdf_text, scenario.source,
      {fmt::format("plant.mechanics={}", mechanics), "plant.encoder.resolution_bits=null",
       fmt::format("plant.integrator.accuracy={}", accuracy)});
}

}  // namespace

void run_in_process(const experiment::Scenario& scenario, controller::ScenarioLaw law,
                    const std::function<bool(const TickRecord&)>& on_tick) {
  plant::GuardedRobot robot(scenario);
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
    law->keep(k);
    record.command = step.command;
    record.controller = step.signals;
    if (!record.command.tau.allFinite()) {
      throw diagnostics::Failure(diagnostics::ExitCode::protective_stop,
                                 "the law commands a torque that is not finite at tick {}: the "
                                 "loop is unstable; shorten loop.period_s or soften the gains",
                                 k);
    }

    robot.accept(record.command);
    record.applied = robot.applied();
    robot.advance(k);
    robot.end_tick();
    if (!on_tick(record)) break;
  }
}

void run_in_process(const experiment::Scenario& scenario,
                    const std::function<bool(const TickRecord&)>& on_tick) {
  run_in_process(scenario, controller::scenario_law(scenario), on_tick);
}

CrossCheck cross_check(const experiment::Scenario& scenario) {
  std::vector<plant::ArmState> expected;
  run_in_process(moved_by("simbody", scenario), [&](const TickRecord& record) {
    expected.push_back(record.truth);
    return true;
  });
  CrossCheck result;
  run_in_process(moved_by("native", scenario), [&](const TickRecord& record) {
    const plant::ArmState& got = record.truth;
    const plant::ArmState& other = expected.at(static_cast<std::size_t>(record.tick));
    const double position = std::max(distance(got.q, other.q), distance(got.theta, other.theta));
    if (position > result.position) {
      result.position = position;
      result.tick = record.tick;
    }
    result.velocity = std::max(
        {result.velocity, distance(got.v, other.v), distance(got.thetadot, other.thetadot)});
    ++result.ticks;
    return true;
  });
  return result;
}

}  // namespace tachless::study

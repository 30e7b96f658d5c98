#include "study/cross_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <string_view>
#include <vector>

#include "study/in_process_loop.h"

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

#include "study/cross_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string_view>
#include <vector>

#include "study/in_process_loop.h"

namespace tachless::study {
namespace {

constexpr double finest_accuracy = 1e-12;

/// The numbers of a true state, one after the other.
void append(const plant::ArmState& truth, std::vector<double>& to) {
  for (const robot::Vector* x : {&truth.q, &truth.v, &truth.theta, &truth.thetadot}) {
    to.insert(to.end(), x->begin(), x->end());
  }
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
  std::vector<double> states;
  run_in_process(moved_by("simbody", scenario), [&](const TickRecord& record) {
    append(record.truth, states);
    return true;
  });
  CrossCheck result;
  auto expected = states.begin();
  std::vector<double> got;
  run_in_process(moved_by("native", scenario), [&](const TickRecord& record) {
    got.clear();
    append(record.truth, got);
    for (const double value : got) {
      const double distance = std::abs(value - *expected) / std::max(1.0, std::abs(*expected));
      ++expected;
      if (distance <= result.distance) continue;
      result.distance = distance;
      result.tick = record.tick;
    }
    ++result.ticks;
    return expected != states.end();
  });
  return result;
}

}  // namespace tachless::study

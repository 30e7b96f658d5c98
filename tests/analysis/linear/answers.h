#pragma once

#include <iterator>
#include <memory>
#include <span>
#include <vector>

#include "controller/registry.h"
#include "linear/scenario_loop.h"
#include "scenario/scenario.h"

namespace tachless::linear {

/// The scenario's own law, asked as a program is.
inline LawAnswers answers_of(const scenario::Scenario& scenario) {
  robot::Model model = *scenario.model;
  model.gravity.setZero();
  scenario::Scenario without_gravity = scenario;
  without_gravity.model = std::make_shared<const robot::Model>(model);
  return [=](double period_s, controller::Gravity gravity,
             std::span<const messages::AnyMeasurement> measurements,
             const messages::ReferencePoint& reference) {
    scenario::Scenario at = controller::with_gains(
        gravity == controller::Gravity::of_scenario ? scenario : without_gravity, reference.gains);
    at.loop.period_s = period_s;
    const controller::ScenarioLaw law = controller::scenario_law(at);
    messages::ReferencePoint held = reference;
    held.gains.clear();  // are the scenario's
    std::vector<Vector> torques;
    for (const messages::AnyMeasurement& each : measurements) {
      torques.push_back(law->step(std::ssize(torques), each, held).command.tau);
    }
    return torques;
  };
}

}  // namespace tachless::linear

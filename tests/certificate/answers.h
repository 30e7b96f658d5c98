#pragma once

#include <iterator>
#include <memory>
#include <span>
#include <vector>

#include "certificate/scenario_loop.h"
#include "controller/registry.h"
#include "experiment/scenario.h"

namespace tachless::certificate {

/// The scenario's own law, asked as a program is.
inline LawAnswers answers_of(const experiment::Scenario& scenario) {
  robot::Model model = *scenario.model;
  model.gravity.setZero();
  experiment::Scenario without_gravity = scenario;
  without_gravity.model = std::make_shared<const robot::Model>(model);
  return [=](double period_s, bool weightless, std::span<const loop::AnyMeasurement> measurements,
             const loop::ReferencePoint& reference) {
    experiment::Scenario at =
        controller::with_gains(weightless ? without_gravity : scenario, reference.gains);
    at.loop.period_s = period_s;
    const controller::ScenarioLaw law = controller::scenario_law(at);
    loop::ReferencePoint held = reference;
    held.gains.clear();  // are the scenario's
    std::vector<robot::Vector> torques;
    for (const loop::AnyMeasurement& each : measurements) {
      torques.push_back(law->step(std::ssize(torques), each, held).command.tau);
    }
    return torques;
  };
}

}  // namespace tachless::certificate

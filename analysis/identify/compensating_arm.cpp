#include "identify/compensating_arm.h"

#include <algorithm>
#include <cmath>

#include "plant/plant_model.h"

namespace tachless::identify {

CompensatingArm::CompensatingArm(const scenario::Scenario& plant,
                                 const scenario::Scenario& believed, double own_late)
    : plant_(plant),
      model_(plant::plant_model(plant)),
      disturbances_(plant.plant.disturbances, plant.loop.period_s, model_),
      arm_(plant::make_arm(plant.plant, plant.robot.flexible, model_,
                           plant::initial_state(plant.plant, plant.robot.flexible, model_),
                           &disturbances_)),
      own_(believed),
      late_(std::max(0, plant.loop.command_delay - believed.loop.command_delay) +
            plant.plant.encoder.latency_ticks),
      ahead_s_((0.5 - own_late) * plant.loop.period_s) {}

void CompensatingArm::reset(const plant::ArmState& initial) {
  arm_.set_state(initial, now_s_ = 0);
  added_.clear();
}

void CompensatingArm::advance(const Vector& tau, double until_s) {
  // With a fraction of a tick of delay, each tick has two calls: the first has the older torque.
  const double ticks = now_s_ / plant_.loop.period_s, tick = std::floor(ticks + 1e-6);
  const bool begins = std::abs(ticks - tick) < 1e-6;
  if (std::ssize(added_) <= static_cast<std::ptrdiff_t>(tick)) {
    const plant::ArmState state = arm_.state();
    added_.push_back(own_.at(state.q, state.v));
    acts_ = own_.at(state.q + ahead_s_ * state.v, state.v);
  }
  const int older = begins && plant_.plant.drive.delay_fraction > 0 ? 1 : 0;
  const auto sent = std::max<std::ptrdiff_t>(0, std::ssize(added_) - 1 - late_ - older);
  arm_.advance(tau + acts_ - added_[static_cast<std::size_t>(sent)], now_s_ = until_s);
}

scenario::Scenario without_mechanics(scenario::Scenario scenario) {
  std::erase_if(scenario.where, [](const auto& each) {
    const std::string& key = each.first;
    return key.starts_with("plant.payload") || key.starts_with("plant.disturbances") ||
           (key.starts_with("plant.drive.") && !key.starts_with("plant.drive.loop"));
  });
  return scenario;
}

}  // namespace tachless::identify

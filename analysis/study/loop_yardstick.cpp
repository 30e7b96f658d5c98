#include "study/loop_yardstick.h"

#include <algorithm>

#include "base/failure.h"
#include "controller/registry.h"
#include "linear/noise.h"
#include "linear/scenario_loop.h"

namespace tachless::study {
namespace {

/// Returns the standard deviation of each entry of a measurement: noise, and a count's rounding,
/// which is uniform over one count.
Eigen::VectorXd measurement_noise(const scenario::Scenario& scenario,
                                  const std::vector<messages::Part>& measured) {
  const plant::EncoderSpec& encoder = scenario.plant.encoder;
  const Vector count = scenario::encoder_count(scenario, *scenario.model);
  const Eigen::Index n = scenario.num_joints;
  Eigen::VectorXd result(n * std::ssize(measured));
  for (std::size_t i = 0; i < measured.size(); ++i) {
    const bool position = measured[i] == messages::Part::q || measured[i] == messages::Part::theta;
    for (Eigen::Index joint = 0; joint < n; ++joint) {
      const double rounding = count.size() > 0 ? count[joint] / std::sqrt(12.0) : 0;
      result[static_cast<Eigen::Index>(i) * n + joint] =
          position ? std::hypot(encoder.noise_std_rad, rounding)
                   : encoder.velocity_noise_std_rad_per_s;
    }
  }
  return result;
}

LoopYardstick at_rest(const scenario::Scenario& scenario, const std::vector<Vector>& postures) {
  LoopYardstick result{.stable = true, .noise = Vector::Zero(scenario.num_joints)};
  const double h = scenario.loop.period_s;
  for (const Vector& q : postures) {
    scenario::Scenario held = scenario;  // a log lacks the table of a reference
    held.reference = reference::trajectory::Hold{q};
    const linear::SampledLoop loop = linear::ScenarioLoop(held).at(linear::constant_reference(q));
    const linear::Modes modes = linear::modes(loop, h);
    const auto error =
        linear::error_by_noise(loop, h, measurement_noise(scenario, loop.law(h).measured));
    if (!modes.stable || !error) return {};
    result.noise = result.noise.cwiseMax(Vector(*error));
    result.settling_s = std::max(result.settling_s, modes.settling_s);
  }
  return result;
}

}  // namespace

void add_loop(Yardsticks& yardsticks, const scenario::Scenario& scenario) {
  const std::string& law = scenario.controller.law;
  if (std::ranges::count(controller::law_names(), law) == 0) return;
  if (!controller::law_facts(law).no_linearisation.empty()) return;
  yardsticks.loop = [&scenario](const std::vector<Vector>& postures) -> LoopYardstick {
    try {
      return at_rest(scenario, postures);
    } catch (const base::Failure&) {
      return {};  // a posture at which the loop has no linear model
    }
  };
}

}  // namespace tachless::study

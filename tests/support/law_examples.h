#pragma once

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <string>
#include <vector>

#include "controller/registry.h"

namespace tachless::support {

/// A shipped scenario of a two-link arm under a law of the catalogue, with gains that are stable
/// there.
struct LawExample {
  std::string law, scenario;
  std::vector<std::string> gains;  ///< in the form of --set

  /// Returns the overrides with the law itself.
  [[nodiscard]] std::vector<std::string> overrides() const {
    std::vector<std::string> all = gains;
    all.push_back("controller.law=" + law);
    return all;
  }
};

/// Returns gains by the law's rule of thumb.
inline std::string ruled_gains(const controller::LawFacts& law) {
  controller::law::Tuning tuning;
  tuning.w = 20;
  tuning.filter = 1000;
  tuning.inertia = Eigen::Vector2d(20, 3);
  if (law.needs_flexible_joints) {
    tuning.stiffness = Eigen::Vector2d(8000, 4000);
    tuning.rotor = Eigen::Vector2d(0.5, 0.3);
  }
  const auto gains = law.tuned(tuning);
  std::string all;
  for (const controller::Parameter& each : law.parameters) {
    const auto found = gains.find(std::string(each.name));
    if (found == gains.end()) continue;  // left to its default
    const Vector& of = found->second;
    const bool one = each.shape != base::Shape::joints;
    all += fmt::format("{}{}: {}", all.empty() ? "" : ", ", each.name,
                       one ? fmt::format("{}", of[0]) : fmt::format("[{}, {}]", of[0], of[1]));
  }
  return fmt::format("controller.gains={{{}}}", all);
}

/// Returns an example of every law. A law without a row here has the gains of its rule of thumb.
inline const std::vector<LawExample>& law_examples() {
  static const std::vector<LawExample> all = [] {
    std::vector<LawExample> examples = {
        {"loria_ortega_rigid", "practical_rigid", {}},
        {"loria_ortega_flexible", "practical_flexible", {}},
        {"kelly_regulation", "regulation", {}},
        {"kelly_flexible", "flexible_regulation", {}},
        {"loria_ortega_matrix",
         "practical_rigid",
         {"controller.gains={kp: [[40000, 2000], [2000, 2400]], kd: [[1000, 50], [50, 60]], "
          "a: 1000, b: 1000}"}},
        {"flexible_motor",
         "practical_flexible",
         {"controller.gains={kp: [1000, 100], kd: [57, 12], a: 980, b: 980}"}},
        {"loria_ortega_adaptive",
         "practical_rigid",
         {"controller.gains={kp: [40000, 2400], kd: [1000, 60], a: 1000, b: 1000, eps_1: 6, "
          "eps_2: 0.03, gamma_mass: 5, mass_max: 3}"}},
        {"loria_ortega_bounded",
         "practical_rigid",
         {"controller.gains={kp: [40000, 2400], kd: [1000, 60], a: 1000, b: 1000}",
          "plant.drive.torque_limit_Nm=[2000, 200]"}},
        {"zhang_dawson", "practical_rigid", {"controller.gains={k: 150}"}},
        {"linear_adrc",
         "practical_rigid",
         {"controller.gains={bandwidth: 10, observer: 200, inertia: [10, 1]}"}},
        {"motor_pd_feedforward",
         "practical_flexible",
         {"controller.gains={kp: [4000, 1000], kv: [80, 40]}"}},
        {"robust_differentiator",
         "practical_rigid",
         {"controller.gains={kp: [4000, 1000], kd: [400, 60], lipschitz: 4000}",
          "plant.initial.velocity_rad_per_s=[1, 1]"}}};
    for (const controller::LawFacts& law : controller::laws()) {
      if (std::ranges::find(examples, law.name, &LawExample::law) != examples.end()) continue;
      const char* scenario = law.needs_flexible_joints ? "practical_flexible"
                             : law.regulation_only     ? "regulation"
                                                       : "practical_rigid";
      examples.push_back({std::string(law.name), scenario, {ruled_gains(law)}});
    }
    return examples;
  }();
  return all;
}

}  // namespace tachless::support

#pragma once

#include <string>
#include <vector>

namespace tachless::support {

/// A shipped scenario under a law of the catalogue, with gains that are stable there.
struct LawExample {
  std::string law, scenario;
  std::vector<std::string> gains;  ///< as given to --set

  /// With the law itself.
  [[nodiscard]] std::vector<std::string> overrides() const {
    std::vector<std::string> all = gains;
    all.push_back("controller.law=" + law);
    return all;
  }
};

/// Every law there is.
inline const std::vector<LawExample>& law_examples() {
  static const std::vector<LawExample> all = {
      {"loria_ortega_rigid", "practical_rigid", {}},
      {"loria_ortega_flexible", "practical_flexible", {}},
      {"loria_ortega_integral",
       "practical_rigid",
       {"controller.gains={kp: [40000, 2400], kd: [1000, 60], a: 1000, b: 1000, ki: [10000, 600], "
        "eps_1: 28, eps_2: 0.14}"}},
      {"loria_ortega_matrix",
       "practical_rigid",
       {"controller.gains={kp: [[40000, 2000], [2000, 2400]], kd: [[1000, 50], [50, 60]], "
        "a: 1000, b: 1000}"}},
      {"loria_ortega_scheduled",
       "practical_rigid",
       {"controller.gains={w: 60, damping: 0.7, a: 1000, b: 1000}"}},
      {"kelly_regulation", "regulation", {}},
      {"kelly_flexible", "flexible_regulation", {}},
      {"wen_bayard", "practical_rigid", {"controller.gains={kp: [40000, 2400], kd: [1000, 60]}"}},
      {"slotine_li", "practical_rigid", {"controller.gains={lambda: 20, ks: [500, 30]}"}},
      {"slotine_li_flexible",
       "practical_flexible",
       {"controller.gains={lambda: 20, ks1: [500, 30], ks2: [10, 10]}"}},
      {"berghuis_nijmeijer",
       "practical_rigid",
       {"controller.gains={lambda: 20, kd: [300, 60], observer_ld: 400}"}},
      {"nicosia_tomei",
       "practical_rigid",
       {"controller.gains={kp: [4000, 1000], kv: [400, 60], observer_kd: 300, "
        "observer_ko: [4e5, 4e4]}"}},
      {"zhang_dawson", "practical_rigid", {"controller.gains={k: 150}"}},
      {"lanari_wen", "practical_flexible", {"controller.gains={kp: [4000, 1000], kv: [80, 40]}"}},
      {"numerical_difference",
       "practical_rigid",
       {"controller.gains={kp: [40000, 2400], kd: [1000, 60], samples: 3}"}},
      {"difference_of_error",
       "practical_rigid",
       {"controller.gains={kp: [40000, 2400], kd: [1000, 60], samples: 3}"}},
      {"kalman_velocity",
       "practical_rigid",
       {"controller.gains={kp: [40000, 2400], kd: [1000, 60], order: 3, process_noise: 1e8}"}},
      {"robust_differentiator",
       "practical_rigid",
       {"controller.gains={kp: [4000, 1000], kd: [400, 60], lipschitz: 4000}",
        "plant.initial.velocity_rad_per_s=[1, 1]"}},
      {"computed_torque", "practical_rigid", {"controller.gains={kp: 400, kd: 40}"}},
      {"pd_gravity", "regulation", {"controller.gains={kp: [40000, 2400], kd: [1000, 60]}"}}};
  return all;
}

}  // namespace tachless::support

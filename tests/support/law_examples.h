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
      {"kelly_regulation", "regulation", {}},
      {"kelly_flexible", "flexible_regulation", {}},
      {"wen_bayard", "practical_rigid", {}},
      {"slotine_li",
       "practical_rigid",
       {"controller.gains.lambda=20", "controller.gains.ks=[500, 30]"}},
      {"slotine_li_flexible",
       "practical_flexible",
       {"controller.gains.lambda=20", "controller.gains.ks1=[500, 30]",
        "controller.gains.ks2=[10, 10]"}},
      {"berghuis_nijmeijer",
       "practical_rigid",
       {"controller.gains.lambda=20", "controller.gains.kd=[300, 60]",
        "controller.gains.observer_ld=400"}},
      {"nicosia_tomei",
       "practical_rigid",
       {"controller.gains.kp=[4000, 1000]", "controller.gains.kv=[400, 60]",
        "controller.gains.observer_kd=300", "controller.gains.observer_ko=[4e5, 4e4]"}},
      {"zhang_dawson", "practical_rigid", {"controller.gains.k=150"}},
      {"lanari_wen",
       "practical_flexible",
       {"controller.gains.kp=[4000, 1000]", "controller.gains.kv=[80, 40]"}},
      {"numerical_difference", "practical_rigid", {"controller.gains.samples=3"}},
      {"kalman_velocity",
       "practical_rigid",
       {"controller.gains.order=3", "controller.gains.process_noise=1e8"}},
      {"robust_differentiator",
       "practical_rigid",
       {"controller.gains.kp=[4000, 1000]", "controller.gains.kd=[400, 60]",
        "controller.gains.lipschitz=4000", "plant.initial.velocity_rad_per_s=[1, 1]"}},
      {"computed_torque", "practical_rigid", {"controller.gains.kp=400", "controller.gains.kd=40"}},
      {"pd_gravity", "regulation", {}}};
  return all;
}

}  // namespace tachless::support

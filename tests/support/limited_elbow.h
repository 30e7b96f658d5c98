#pragma once

#include <stdexcept>
#include <string>
#include <string_view>

#include "scenario/scenario.h"

namespace tachless {

/// Returns a scenario of the two-link arm with these attributes of <limit> for its elbow; the arm
/// itself has no limits: `lower="-1" upper="2" effort="100" velocity="10"`.
inline scenario::Scenario with_limited_elbow(const scenario::Scenario& scenario,
                                             const std::string& attributes) {
  constexpr std::string_view elbow = R"(<joint name="elbow" type="continuous">)";
  std::string urdf = scenario.robot.urdf_text;
  const std::size_t at = urdf.find(elbow);
  if (at == std::string::npos) throw std::logic_error("not the two-link arm");
  urdf.replace(at, elbow.size(),
               R"(<joint name="elbow" type="revolute"><limit )" + attributes + "/>");
  return scenario::parse_scenario(scenario.text, urdf, scenario.source);
}

}  // namespace tachless

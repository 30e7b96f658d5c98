#include "commission/misfits.h"

#include <algorithm>
#include <cmath>
#include <optional>

namespace tachless::commission {
namespace {

using scenario::Scenario;

std::string name_of_joint(const Scenario& scenario, Eigen::Index joint) {
  return robot::joint_labels(*scenario.model).joint(static_cast<std::size_t>(joint));
}

}  // namespace

void add_misfit(Commissioned& found, const std::string& key, const std::string& what,
                std::vector<std::string> overrides) {
  found.misfits.push_back(fmt::format("{}: {}", key, what));
  found.mendable = found.mendable && !overrides.empty();
  found.overrides.insert(found.overrides.end(), overrides.begin(), overrides.end());
}

void judge_delay(const Scenario& scenario, int whole, Commissioned& found) {
  std::vector<double> delays;
  for (const Commissioned::Joint& joint : found.joints) {
    if (joint.delay) delays.push_back(*joint.delay);
  }
  if (delays.empty()) return;
  std::ranges::sort(delays);
  const double middle = delays[delays.size() / 2];
  found.delay_spread = delays.back() - delays.front();
  if (std::abs(middle - whole) < 0.3 && found.delay_spread < 0.8) {
    found.delay = whole + scenario.loop.command_delay;
  }
}

void judge_friction(const Scenario& scenario, const Vector& speed, const Explanation& explanation,
                    Commissioned& found) {
  const Scenario stated = scenario::parse_scenario(
      scenario.text, scenario.robot.urdf_text, scenario.source, {"robot.compensates.friction=0"});
  const plant::DriveSpec& drive = stated.plant.drive;
  double seen = 0, expected = 0;
  for (std::size_t j = 0; j < explanation.joints.size(); ++j) {
    const auto i = static_cast<Eigen::Index>(j);
    const Explanation::Joint& joint = explanation.joints[j];
    const double v = 0.2 * speed[i];
    const double there = drive.coulomb_friction_Nm[i] + v * drive.viscous_friction_Nms_per_rad[i];
    if (!(there > 5 * joint.resolution) || joint.scale <= 0) continue;
    seen += joint.scale * (joint.dry + v * joint.viscous) / there;
    expected += 1;
  }
  if (expected == 0) return;
  if (seen < 0.25 * expected) found.adds_friction = true;
  if (seen > 0.6 * expected) found.adds_friction = false;
}

void compare_signs(const Scenario& scenario, const std::vector<Vector>& possible,
                   Commissioned& found) {
  std::string either;
  for (const Vector& each : possible) {
    if ((each.array() > 0).all()) return;  // as the scenario states
    std::string joints;
    for (Eigen::Index i = 0; i < each.size(); ++i) {
      if (each[i] < 0) joints += (joints.empty() ? "" : ", ") + name_of_joint(scenario, i);
    }
    either += (either.empty() ? "" : "; or else ") + joints;
  }
  const Vector signs = scenario.robot.joint_signs.cwiseProduct(possible.front());
  const bool one = possible.size() == 1;
  const Vector start = turned(scenario.plant.initial.position_rad, possible.front(),
                              scenario.robot.joint_offsets_rad);
  std::vector<std::string> overrides = {"robot.joint_signs=" + list(signs),
                                        "plant.initial.position_rad=" + list(start)};
  if (!one) overrides.clear();
  add_misfit(
      found, "robot.joint_signs",
      fmt::format("turns against the URDF: {}; {}{}", either,
                  one ? "write robot.joint_signs: " : "look which, and write robot.joint_signs",
                  one ? list(signs) : ""),
      std::move(overrides));
}

void compare_scales(const Scenario& scenario, const std::vector<double>& heavier,
                    Commissioned& found) {
  for (std::size_t j = 0; j < found.joints.size(); ++j) {
    const Commissioned::Joint& joint = found.joints[j];
    if (heavier[j] > 0) {
      add_misfit(
          found, "robot.joints.rigid.rotor_inertia_kgm2",
          fmt::format("{} moves as with {:.3g} more than the scenario's {:.3g}; write their "
                      "sum, or state a load as plant.payload",
                      joint.name, heavier[j],
                      scenario.robot.rigid_rotor_inertia_kgm2.size() == 0
                          ? 0.0
                          : scenario.robot.rigid_rotor_inertia_kgm2[static_cast<Eigen::Index>(j)]));
    }
    if (!joint.scale || std::abs(*joint.scale - 1) < 0.15) continue;
    if (*joint.scale < 0) {
      add_misfit(found, "robot.joint_signs",
                 fmt::format("{} moves against its own torque; correct the driver: joint_signs "
                             "turns position and torque",
                             joint.name));
    } else if (*joint.scale < 1) {
      add_misfit(found, "robot.joints.rigid.rotor_inertia_kgm2",
                 fmt::format("{} answers as to {:.3g} times the torque that it is sent; a rotor or "
                             "a load (plant.payload) that the scenario does not state has this "
                             "effect, and so has the unit or gear of the driver's torque",
                             joint.name, *joint.scale));
    } else {
      add_misfit(found, "scale of torque",
                 fmt::format("{} answers as to {:.3g} times the torque that it is sent; correct "
                             "units or gear in the driver, or the URDF's inertia",
                             joint.name, *joint.scale));
    }
  }
}

void compare_gravity(const Scenario& scenario, Commissioned& found) {
  const scenario::CompensationSpec& says = scenario.robot.compensates;
  if (!found.adds_gravity) {
    return add_misfit(found, "robot.compensates",
                      "whether the arm adds gravity is not determined; begin where gravity pulls "
                      "more, with a finer encoder");
  }
  scenario::CompensationSpec is = says;
  is.gravity = *found.adds_gravity;
  if (const auto& friction = found.adds_friction; !is.gravity || (friction && !*friction)) {
    is.friction = 0;
  } else if (friction && is.friction == 0) {
    is.friction = 1;
  }
  if (is.gravity == says.gravity && is.friction == says.friction) return;
  const char* effect = is.gravity == says.gravity ? "friction would be counted wrongly"
                       : is.gravity               ? "gravity would be sent twice"
                                                  : "the arm would fall";
  add_misfit(found, "robot.compensates",
             fmt::format("{}, but the arm adds {}: {}; write robot.compensates: {{gravity: {}, "
                         "friction: {}}}",
                         says.text(), is.text(), effect, is.gravity, is.friction),
             {fmt::format("robot.compensates.gravity={}", is.gravity),
              fmt::format("robot.compensates.friction={}", is.friction)});
}

void compare_delay(const Scenario& scenario, Commissioned& found) {
  if (!found.delay) return;
  const int latency = *found.delay - scenario.loop.command_delay;
  if (latency == scenario.plant.encoder.latency_ticks) return;
  add_misfit(found, "plant.encoder.latency_ticks",
             fmt::format("{}, but a torque acts {} ticks after its reading; write "
                         "plant.encoder.latency_ticks: {}",
                         scenario.plant.encoder.latency_ticks, *found.delay, latency),
             {fmt::format("plant.encoder.latency_ticks={}", latency)});
}

}  // namespace tachless::commission

#pragma once

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "commission/commission.h"
#include "commission/hypotheses.h"
#include "robot/model.h"

namespace tachless::commission {

using scenario::Scenario;

/// Returns the largest speed allowed to each joint of an unknown arm [rad/s; m/s]. It is a tenth of
/// the joint's limit, or 0.1 if the URDF has no limit.
inline Vector careful_speed(const robot::Model& model) {
  return model.velocity_limit.unaryExpr(
      [](double limit) { return 0.1 * (std::isfinite(limit) ? limit : 1.0); });
}

inline std::string list(const Vector& values) {
  return fmt::format("[{:.9g}]", fmt::join(values, ", "));
}

/// The findings of a commissioning, compared with the scenario.
class Findings {
 protected:
  explicit Findings(const Scenario& scenario)
      : scenario_(scenario), speed_(careful_speed(*scenario.model)) {}

  [[nodiscard]] std::string name(Eigen::Index joint) const {
    return robot::joint_labels(*scenario_.model).joint(static_cast<std::size_t>(joint));
  }

  [[nodiscard]] Vector start_with(const Vector& signs) const {
    return turned(scenario_.plant.initial.position_rad, signs, scenario_.robot.joint_offsets_rad);
  }

  void judge_delay(std::vector<double> delays, int whole) {
    if (delays.empty()) return;
    std::ranges::sort(delays);
    const double middle = delays[delays.size() / 2];
    result_.delay_spread = delays.back() - delays.front();
    if (std::abs(middle - whole) < 0.3 && result_.delay_spread < 0.8) {
      result_.delay = whole + std::max(1, scenario_.loop.command_delay);
    }
  }

  /// Compares the found friction with the friction that the scenario states for an arm without
  /// compensation.
  void judge_friction(const Explanation& found) {
    const Scenario stated =
        scenario::parse_scenario(scenario_.text, scenario_.robot.urdf_text, scenario_.source,
                                 {"robot.compensates.friction=0"});
    const plant::DriveSpec& drive = stated.plant.drive;
    double seen = 0, expected = 0;
    for (std::size_t j = 0; j < found.joints.size(); ++j) {
      const auto i = static_cast<Eigen::Index>(j);
      const Explanation::Joint& of = found.joints[j];
      const double v = 0.2 * speed_[i];
      const double there = drive.coulomb_friction_Nm[i] + v * drive.viscous_friction_Nms_per_rad[i];
      if (there <= 5 * of.resolution || of.scale <= 0) continue;
      seen += of.scale * (of.dry + v * of.viscous) / there;
      expected += 1;
    }
    if (expected == 0) return;
    if (seen < 0.25 * expected) result_.adds_friction = true;
    if (seen > 0.6 * expected) result_.adds_friction = false;
  }

  void misfit(const std::string& key, const std::string& what, bool mendable,
              std::vector<std::string> overrides = {}) {
    result_.misfits.push_back(fmt::format("{}: {}", key, what));
    result_.mendable = result_.mendable && mendable;
    result_.overrides.insert(result_.overrides.end(), overrides.begin(), overrides.end());
  }

  void mend_signs(std::vector<Vector> explanations) {
    std::string either;
    for (Vector& each : explanations) {
      each = turned_by_.cwiseProduct(each);
      if ((each.array() > 0).all()) return;  // as the scenario states
      std::string joints;
      for (Eigen::Index i = 0; i < each.size(); ++i) {
        if (each[i] < 0) joints += (joints.empty() ? "" : ", ") + name(i);
      }
      either += (either.empty() ? "" : "; or else ") + joints;
    }
    const Vector signs = scenario_.robot.joint_signs.cwiseProduct(explanations.front());
    const bool one = explanations.size() == 1;
    misfit(
        "robot.joint_signs",
        fmt::format("turns against the URDF: {}; {}{}", either,
                    one ? "write robot.joint_signs: " : "look which, and write robot.joint_signs",
                    one ? list(signs) : ""),
        one,
        {fmt::format("robot.joint_signs={}", list(signs)),
         fmt::format("plant.initial.position_rad={}", list(start_with(explanations.front())))});
  }

  void mend_scales() {
    for (const Commissioned::Joint& joint : result_.joints) {
      if (!joint.scale || std::abs(*joint.scale - 1) < 0.15) continue;
      if (*joint.scale < 0) {
        misfit("robot.joint_signs",
               fmt::format("{} moves against its own torque; correct the driver: joint_signs turns "
                           "position and torque",
                           joint.name),
               false);
        continue;
      }
      misfit(
          "scale of torque",
          fmt::format("{} answers as to {:.3g} times the torque that it is sent; correct units or "
                      "gear in the driver, or the URDF's inertia",
                      joint.name, *joint.scale),
          false);
    }
  }

  void mend_gravity() {
    const scenario::CompensationSpec& says = scenario_.robot.compensates;
    if (!result_.adds_gravity) {
      misfit(
          "robot.compensates",
          "whether the arm adds gravity is not determined; begin where gravity pulls more, with a "
          "finer encoder",
          false);
      return;
    }
    scenario::CompensationSpec is = says;
    is.gravity = *result_.adds_gravity;
    if (const auto& friction = result_.adds_friction; !is.gravity || (friction && !*friction)) {
      is.friction = 0;
    } else if (friction && is.friction == 0) {
      is.friction = 1;
    }
    if (is.gravity == says.gravity && is.friction == says.friction) return;
    misfit("robot.compensates",
           fmt::format("{}, but the arm adds {}: {}; write robot.compensates: {{gravity: {}, "
                       "friction: {}}}",
                       says.text(), is.text(),
                       is.gravity == says.gravity ? "friction would be counted wrongly"
                       : is.gravity               ? "gravity would be sent twice"
                                                  : "the arm would fall",
                       is.gravity, is.friction),
           true,
           {fmt::format("robot.compensates.gravity={}", is.gravity),
            fmt::format("robot.compensates.friction={}", is.friction)});
  }

  void mend_delay() {
    if (!result_.delay) return;
    const int latency = *result_.delay - std::max(1, scenario_.loop.command_delay);
    if (latency == scenario_.plant.encoder.latency_ticks) return;
    misfit("plant.encoder.latency_ticks",
           fmt::format("{}, but a torque acts {} ticks after its reading; write "
                       "plant.encoder.latency_ticks: {}",
                       scenario_.plant.encoder.latency_ticks, *result_.delay, latency),
           true, {fmt::format("plant.encoder.latency_ticks={}", latency)});
  }

  const Scenario& scenario_;
  Vector speed_;                                           ///< speed that no joint may exceed
  Vector turned_by_ = Vector::Ones(scenario_.num_joints);  ///< signs found by letting the arm fall
  Commissioned result_;
};

}  // namespace tachless::commission

#pragma once

#include <fmt/format.h>

#include <string>
#include <vector>

#include "robot/model.h"

namespace tachless::robot {

/// What people read beside a joint's values: its name in the URDF, and the units of what is an
/// angle on a revolute joint and a torque there.
struct JointLabels {
  std::vector<std::string> name;
  std::vector<std::string> length;  ///< "rad" or "m"
  std::vector<std::string> effort;  ///< "N m" or "N"

  /// "joint 2 (elbow)"; counts from 0.
  [[nodiscard]] std::string joint(std::size_t i) const {
    return fmt::format("joint {} ({})", i + 1, name[i]);
  }
};

inline JointLabels joint_labels(const robot::Model& model) {
  JointLabels labels{model.joint_names, {}, {}};
  for (const robot::JointType type : model.joint_types) {
    const bool revolute = type == robot::JointType::revolute;
    labels.length.emplace_back(revolute ? "rad" : "m");
    labels.effort.emplace_back(revolute ? "N m" : "N");
  }
  return labels;
}

}  // namespace tachless::robot

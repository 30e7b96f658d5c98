#pragma once

#include <string>
#include <vector>

#include "robot/model.h"

namespace tachless::robot {

/// Units of what is an angle on a revolute joint and a torque there, per joint.
struct JointUnits {
  std::vector<std::string> length;  ///< "rad" or "m"
  std::vector<std::string> effort;  ///< "N m" or "N"
};

inline JointUnits joint_units(const robot::Model& model) {
  JointUnits units;
  for (const robot::JointType type : model.joint_types) {
    const bool revolute = type == robot::JointType::revolute;
    units.length.emplace_back(revolute ? "rad" : "m");
    units.effort.emplace_back(revolute ? "N m" : "N");
  }
  return units;
}

}  // namespace tachless::robot

#include "robot/typical_rotors.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdlib>
#include <stdexcept>

namespace tachless::robot {

Vector typical_rotor_inertia(const Model& model) {
  Vector inertia = Vector::Zero(model.num_joints);
  for (int j = 0; j < model.num_joints; ++j) {
    const auto i = static_cast<std::size_t>(j);
    if (model.joint_types[i] == JointType::prismatic) continue;
    if (!std::isfinite(model.effort_limit[j])) {
      throw std::invalid_argument(
          fmt::format("joint {} has no effort limit, from which the typical rotor inertia follows: "
                      "add <limit effort=\"…\"/> to the URDF",
                      model.joint_names[i]));
    }
    const std::string digits =
        fmt::format("{:.2g}", rotor_inertia_per_torque * model.effort_limit[j]);
    inertia[j] = std::strtod(digits.c_str(), nullptr);
  }
  return inertia;
}

}  // namespace tachless::robot

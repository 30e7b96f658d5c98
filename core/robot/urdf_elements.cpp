#include "robot/urdf_elements.h"

#include <algorithm>
#include <array>
#include <map>

namespace tachless::robot {

const ElementRule* rule_of(std::string_view element) {
  static const std::map<std::string_view, ElementRule> rules{
      {"link",
       {{"inertial"},
        {"visual", "collision", "contact", "self_collision_checking"},
        {"name", "type"}}},
      {"inertial", {{"origin", "mass", "inertia"}, {}, {}}},
      {"joint",
       {{"origin", "parent", "child", "axis", "limit", "dynamics", "mimic",
         "position_based_velocity_limits"},
        {"calibration", "safety_controller", "hardwareInterface"},
        {"name", "type"}}},
      {"origin", {{}, {}, {"xyz", "rpy", "quat_xyzw"}}},
      {"mass", {{}, {}, {"value"}}},
      {"inertia", {{}, {}, {"ixx", "ixy", "ixz", "iyy", "iyz", "izz", "iyx", "izx", "izy"}}},
      {"parent", {{}, {}, {"link"}}},
      {"child", {{}, {}, {"link"}}},
      {"axis", {{}, {}, {"xyz"}}},
      {"limit",
       {{},
        {},
        {"lower", "upper", "effort", "velocity", "acceleration", "deceleration", "jerk",
         "drake:acceleration"}}},
      {"position_based_velocity_limits", {{}, {}, {"deceleration_limit", "velocity_offset"}}},
      {"dynamics", {{}, {}, {"damping", "friction", "armature"}}},
      {"mimic", {{}, {}, {"joint", "multiplier", "offset"}}}};
  const auto found = rules.find(element);
  return found == rules.end() ? nullptr : &found->second;
}

bool is_mechanics(std::string_view attribute) {
  static constexpr std::array<std::string_view, 20> names{"xyz",
                                                          "rpy",
                                                          "quat_xyzw",
                                                          "lower",
                                                          "upper",
                                                          "effort",
                                                          "velocity",
                                                          "damping",
                                                          "friction",
                                                          "multiplier",
                                                          "offset",
                                                          "ixx",
                                                          "ixy",
                                                          "ixz",
                                                          "iyy",
                                                          "iyz",
                                                          "izz",
                                                          "armature",
                                                          "deceleration_limit",
                                                          "velocity_offset"};
  return std::ranges::find(names, attribute) != names.end();
}

const std::vector<std::string_view>& robot_children() {
  static const std::vector<std::string_view> names{"link",
                                                   "joint",
                                                   "material",
                                                   "transmission",
                                                   "gazebo",
                                                   "ros2_control",
                                                   "sensor",
                                                   "group_state",
                                                   "group",
                                                   "mujoco",
                                                   "loop_joint",
                                                   "frame",
                                                   "preserveFixedJoint",
                                                   "self_collision_checking"};
  return names;
}

}  // namespace tachless::robot

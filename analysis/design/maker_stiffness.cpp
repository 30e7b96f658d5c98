#include "design/maker_stiffness.h"

#include <algorithm>
#include <array>
#include <string_view>
#include <vector>

namespace tachless::design {
namespace {

constexpr int most_arm_joints = 7;

struct Arm {
  std::string_view name, source;
  std::vector<std::string_view> joints;  ///< each a part of the joint's name
  double effort;  ///< of the first joint, which tells arms of one family apart [N m]; 0: any
  std::array<double, most_arm_joints> stiffness;
};

const std::vector<Arm>& arms() {
  static const std::vector<std::string_view> franka = {"joint1", "joint2", "joint3", "joint4",
                                                       "joint5", "joint6", "joint7"};
  static const std::vector<std::string_view> ur = {"shoulder_pan_joint", "shoulder_lift_joint",
                                                   "elbow_joint",        "wrist_1_joint",
                                                   "wrist_2_joint",      "wrist_3_joint"};
  static const std::vector<std::string_view> iiwa = {"iiwa_joint_1", "iiwa_joint_2", "iiwa_joint_3",
                                                     "iiwa_joint_4", "iiwa_joint_5", "iiwa_joint_6",
                                                     "iiwa_joint_7"};
  constexpr std::string_view kuka_driver =
      "kroshu/ros2_kuka_sunrise, default stiffness of its joint impedance mode";
  constexpr std::string_view libfranka = "libfranka, setJointImpedance in its examples";
  constexpr std::string_view ur_client =
      "Universal Robots Client Library, default gains of its torque controller";
  constexpr std::array<double, most_arm_joints> fci = {3000, 3000, 3000, 2500, 2500, 2000, 2000};
  static const std::vector<Arm> all = {
      {"Franka arm", libfranka, franka, 87, fci},
      {"LBR iiwa", kuka_driver, iiwa, 0, {1000, 1000, 1000, 1000, 1000, 1000, 1000}},
      {"UR3", ur_client, ur, 54, {560, 560, 350, 163, 163, 163}},
      {"UR3e", ur_client, ur, 56, {560, 560, 350, 163, 163, 163}},
      {"UR5", ur_client, ur, 150, {900, 900, 900, 500, 500, 500}},
      {"UR10", ur_client, ur, 330, {1300, 1300, 900, 560, 560, 560}},
  };
  return all;
}

bool is(const Arm& arm, const robot::Model& model) {
  const std::size_t count = arm.joints.size();
  if (model.joint_names.size() < count) return false;
  if (arm.effort > 0 && model.effort_limit[0] != arm.effort) return false;
  for (std::size_t j = 0; j < count; ++j) {
    if (model.joint_names[j].find(arm.joints[j]) == std::string::npos) return false;
  }
  return true;
}

}  // namespace

std::optional<MakerStiffness> maker_stiffness(const robot::Model& model) {
  const auto found = std::ranges::find_if(arms(), [&](const Arm& each) { return is(each, model); });
  if (found == arms().end()) return {};
  MakerStiffness known{std::string(found->name), std::string(found->source),
                       Vector::Zero(model.num_joints)};
  for (std::size_t j = 0; j < found->joints.size(); ++j) {
    known.N_m_per_rad[static_cast<Eigen::Index>(j)] = found->stiffness[j];
  }
  return known;
}

}  // namespace tachless::design

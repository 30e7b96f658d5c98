#include "robot/gravity_bound.h"

#include <algorithm>
#include <cmath>

namespace tachless::robot {
namespace {

/// Returns the longest way that a body's joint moves it [m].
double travel(const Model& model, const Body& body) {
  if (body.type == JointType::revolute) return 0;
  const double end =
      std::max(std::abs(model.lower[body.coordinate]), std::abs(model.upper[body.coordinate]));
  return std::abs(body.multiplier) * end + std::abs(body.offset);
}

}  // namespace

Vector gravity_bound(const Model& model) {
  Vector bound = Vector::Zero(model.num_joints);
  for (const Body& body : model.bodies) {
    double length = body.p_Bcm.norm();  // from the origin of `joint` to the body's centre of mass
    for (const Body* joint = &body;;) {
      const bool turns = joint->type == JointType::revolute;
      Eigen::Vector3d pull = model.gravity;
      if (joint->parent < 0) {
        const Eigen::Vector3d axis = joint->R_PB * joint->axis_B;
        const double along = axis.dot(pull);
        pull = turns ? Eigen::Vector3d(pull - along * axis) : Eigen::Vector3d(along * axis);
      }
      bound[joint->coordinate] +=
          std::abs(joint->multiplier) * body.mass * pull.norm() * (turns ? length : 1);
      if (joint->parent < 0) break;
      length += joint->p_PB.norm() + travel(model, *joint);
      joint = &model.bodies[static_cast<std::size_t>(joint->parent)];
    }
  }
  return bound;
}

}  // namespace tachless::robot

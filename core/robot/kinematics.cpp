#include "robot/kinematics.h"

#include <Eigen/Geometry>
#include <stdexcept>

namespace tachless::robot {

void require_size(const Model& model, Eigen::Index size, const char* what) {
  if (size != model.num_joints) {
    throw std::logic_error(std::string("robot: ") + what + " has " + std::to_string(size) +
                           " entries, the model has " + std::to_string(model.num_joints) +
                           " coordinates");
  }
}

Pose<double> frame_pose(const Model& model, const Frame& frame, const Vector& q) {
  require_size(model, q.size(), "q");
  Pose<double> X{frame.R_BF, frame.p_BF};
  for (int i = frame.body; i >= 0; i = model.bodies[i].parent) {
    X = joint_pose(model.bodies[i], q) * X;
  }
  return X;
}

Pose<double> frame_pose(const Model& model, const std::string& link, const Vector& q) {
  const auto found = model.frames.find(link);
  if (found == model.frames.end()) {
    throw std::invalid_argument("the robot has no link '" + link + "'");
  }
  return frame_pose(model, found->second, q);
}

Vector force_torque(const Model& model, const Frame& frame, const Eigen::Vector3d& p_F,
                    const Eigen::Vector3d& force, const Vector& q) {
  Vector torque = Vector::Zero(model.num_joints);
  Frame of_body;
  of_body.body = frame.body;
  // Force and moment about the body's origin, in the body's frame, from body to body.
  Eigen::Vector3d f = frame_pose(model, of_body, q).R.transpose() * force;
  Eigen::Vector3d m = (frame.p_BF + frame.R_BF * p_F).cross(f);
  for (int i = frame.body; i >= 0; i = model.bodies[i].parent) {
    const Body& body = model.bodies[i];
    torque[body.coordinate] +=
        body.multiplier * body.axis_B.dot(body.type == JointType::revolute ? m : f);
    const Pose<double> X_PB = joint_pose(body, q);
    f = (X_PB.R * f).eval();
    m = (X_PB.R * m + X_PB.p.cross(f)).eval();
  }
  return torque;
}

}  // namespace tachless::robot

#pragma once

#include <Eigen/Geometry>

#include "robot/kinematics.h"

namespace tachless::robot::testing {

/// v' M(q) v / 2 [J], rotor inertia included; body by body, independent of the mass matrix.
template <class Scalar>
Scalar kinetic_energy(const Model& model, const VectorOf<Scalar>& q, const VectorOf<Scalar>& v) {
  using Vector3 = Vector3Of<Scalar>;
  require_size(model, q.size(), "q");
  require_size(model, v.size(), "v");
  struct Rates {
    Vector3 angular, linear;  // of the body's frame, expressed in it
  };
  Rates rates[max_bodies];
  Scalar twice = Scalar(0);
  for (std::size_t i = 0; i < model.bodies.size(); ++i) {
    const Body& body = model.bodies[i];
    const Pose<Scalar> X = joint_pose(body, q);
    Rates& b = rates[i];
    if (body.parent < 0) {
      b.angular.setZero();
      b.linear.setZero();
    } else {
      const Rates& p = rates[body.parent];
      b.angular = X.R.transpose() * p.angular;
      const Vector3 carried = p.linear + p.angular.cross(X.p);
      b.linear = X.R.transpose() * carried;
    }
    const Vector3 joint = body.axis_B * Scalar(body.multiplier * v[body.coordinate]);
    (body.type == JointType::revolute ? b.angular : b.linear) += joint;
    const Vector3 c = body.p_Bcm.template cast<Scalar>();
    const Vector3 v_cm = b.linear + b.angular.cross(c);
    const Vector3 L = body.I_Bcm * b.angular;
    twice += body.mass * v_cm.dot(v_cm) + b.angular.dot(L);
  }
  for (Eigen::Index j = 0; j < model.rotor_inertia.size(); ++j) {
    twice += model.rotor_inertia[j] * (v[j] * v[j]);
  }
  return 0.5 * twice;
}

}  // namespace tachless::robot::testing

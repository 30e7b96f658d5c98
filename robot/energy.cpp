#include "robot/energy.h"

#include "robot/kinematics.h"

namespace tachless::robot {

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
    const Pose<Scalar> X = joint_pose(body, tree_position(body, q));
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
    const Vector3 joint = scaled<Scalar>(body.axis_B, body.multiplier * v[body.coordinate]);
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

template <class Scalar>
Scalar potential_energy(const Model& model, const VectorOf<Scalar>& q) {
  require_size(model, q.size(), "q");
  Pose<Scalar> pose[max_bodies];
  Scalar energy = Scalar(0);
  for (std::size_t i = 0; i < model.bodies.size(); ++i) {
    const Body& body = model.bodies[i];
    Pose<Scalar>& X = pose[i];
    X = joint_pose(body, tree_position(body, q));
    if (body.parent >= 0) {
      const Pose<Scalar>& P = pose[body.parent];
      X.p = (P.R * X.p + P.p).eval();
      X.R = (P.R * X.R).eval();
    }
    const Vector3Of<Scalar> p_cm = X.R * body.p_Bcm + X.p;
    for (int k = 0; k < 3; ++k) energy -= (body.mass * model.gravity[k]) * p_cm[k];
  }
  return energy;
}

template double kinetic_energy(const Model&, const VectorOf<double>&, const VectorOf<double>&);
template Jet2 kinetic_energy(const Model&, const VectorOf<Jet2>&, const VectorOf<Jet2>&);
template double potential_energy(const Model&, const VectorOf<double>&);
template Jet2 potential_energy(const Model&, const VectorOf<Jet2>&);

}  // namespace tachless::robot

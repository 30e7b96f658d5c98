#include "robot/mass_matrix.h"

#include <algorithm>

#include "robot/kinematics.h"

namespace tachless::robot {
namespace {

/// A body with all that hangs on it, frozen; about and in the body's frame.
template <class Scalar>
struct Composite {
  Pose<Scalar> X_PB;
  Vector3Of<Scalar> h;  ///< mass times centre of mass [kg m]
  Matrix3Of<Scalar> I;  ///< about the body's origin [kg m2]
  double mass;
};

/// |r|^2 1 - r r', polarised: the parallel-axis matrix of the pair (a, b).
template <class A, class B>
auto parallel_axis(const A& a, const B& b) {
  using Scalar = typename A::Scalar;
  Matrix3Of<Scalar> I = -(a * b.transpose());
  const Scalar dot = a.dot(b);
  for (int k = 0; k < 3; ++k) I(k, k) += dot;
  return I;
}

}  // namespace

template <class Scalar>
MatrixOf<Scalar> mass_matrix(const Model& model, const VectorOf<Scalar>& q) {
  using Vector3 = Vector3Of<Scalar>;
  require_size(model, q.size(), "q");
  const int n = model.num_joints;
  const int num_bodies = static_cast<int>(model.bodies.size());

  Composite<Scalar> composite[max_bodies];
  for (int i = 0; i < num_bodies; ++i) {
    const Body& body = model.bodies[i];
    Composite<Scalar>& b = composite[i];
    b.X_PB = joint_pose(body, tree_position(body, q));
    b.mass = body.mass;
    b.h = (body.mass * body.p_Bcm).template cast<Scalar>();
    b.I = (body.I_Bcm + body.mass * parallel_axis(body.p_Bcm, body.p_Bcm)).template cast<Scalar>();
  }

  MatrixOf<Scalar> M(n, n);
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < n; ++i) M(i, j) = Scalar(0);
  }
  for (int i = num_bodies - 1; i >= 0; --i) {
    const Body& body = model.bodies[i];
    const Composite<Scalar>& b = composite[i];

    // Momentum of the composite under unit rate of its joint, about the origin it is carried to.
    Vector3 linear, angular;
    if (body.type == JointType::revolute) {
      linear = body.axis_B.cast<Scalar>().cross(b.h);
      angular = b.I * body.axis_B;
    } else {
      linear = b.mass * body.axis_B.cast<Scalar>();
      angular = b.h.cross(body.axis_B.cast<Scalar>());
    }
    for (int k = i;;) {
      const Body& ancestor = model.bodies[k];
      const Vector3& along = ancestor.type == JointType::revolute ? angular : linear;
      const Scalar element = (body.multiplier * ancestor.multiplier) *
                             (ancestor.axis_B[0] * along[0] + ancestor.axis_B[1] * along[1] +
                              ancestor.axis_B[2] * along[2]);
      const int row = std::max(body.coordinate, ancestor.coordinate);
      const int col = std::min(body.coordinate, ancestor.coordinate);
      M(row, col) += element;
      // Two bodies of one coordinate meet twice on the diagonal, as (i, k) and as (k, i).
      if (k != i && row == col) M(row, col) += element;
      if (ancestor.parent < 0) break;
      const Pose<Scalar>& X = composite[k].X_PB;
      linear = (X.R * linear).eval();
      angular = (X.R * angular + X.p.cross(linear)).eval();
      k = ancestor.parent;
    }

    if (body.parent >= 0) {
      Composite<Scalar>& p = composite[body.parent];
      const Matrix3Of<Scalar>& R = b.X_PB.R;
      const Vector3& r = b.X_PB.p;
      const Vector3 h_P = R * b.h;
      const Matrix3Of<Scalar> I_P = R * b.I * R.transpose();
      const Matrix3Of<Scalar> mixed = parallel_axis(r, h_P);
      p.I += I_P + mixed + mixed.transpose() + b.mass * parallel_axis(r, r);
      p.h += h_P + b.mass * r;
      p.mass += b.mass;
    }
  }
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < j; ++i) M(i, j) = M(j, i);
  }
  if (model.rotor_inertia.size() != 0) {
    require_size(model, model.rotor_inertia.size(), "rotor_inertia");
    for (int j = 0; j < n; ++j) M(j, j) += model.rotor_inertia[j];
  }
  return M;
}

template MatrixOf<double> mass_matrix(const Model&, const VectorOf<double>&);
template MatrixOf<Jet2> mass_matrix(const Model&, const VectorOf<Jet2>&);

}  // namespace tachless::robot

#include "robot/dynamics.h"

#include <alloca.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cstddef>
#include <stdexcept>

#include "robot/cholesky.h"
#include "robot/kinematics.h"

/// Uninitialised memory for one value of a type for each body of `model`, on the stack of the
/// function that writes this. A step of a law thereby needs as much stack as its robot has bodies,
/// and allocates nothing.
#define TACHLESS_PER_BODY(Type) static_cast<Type*>(alloca(model.bodies.size() * sizeof(Type)))

namespace tachless::robot {
namespace {

/// Returns the component along an axis; sums run from the left.
template <class Axis, class Scalar>
Scalar component(const Vector3Of<Axis>& axis, const Vector3Of<Scalar>& x) {
  return axis[0] * x[0] + axis[1] * x[1] + axis[2] * x[2];
}

/// A body's quantities in the recursion, in the body's frame.
template <class Scalar>
struct BodyState {
  using Vector3 = Vector3Of<Scalar>;
  Vector3 w_x, w_y;  ///< angular velocity under x and under y
  Vector3 alpha;     ///< angular acceleration
  Vector3 acc;       ///< acceleration of the origin, less gravity
  Vector3 f, n;      ///< force on the body through its joint, moment about the origin

  /// Returns a product of two velocities, symmetrised when x and y are `two`.
  template <bool two, class Product>
  [[nodiscard]] Vector3 of_velocities(const Product& product) const {
    if constexpr (!two) return product(w_x, w_x);
    return (product(w_x, w_y) + product(w_y, w_x)) * 0.5;
  }
  /// Returns the acceleration of the body's point r.
  template <bool two>
  [[nodiscard]] Vector3 acceleration_at(const Vector3& r) const {
    return acc + alpha.cross(r) + of_velocities<two>([&](const Vector3& x, const Vector3& y) {
             return Vector3(x.cross(y.cross(r)));
           });
  }
};

template <class Scalar>
[[gnu::flatten]] void set_joint_poses(const Model& model, const VectorOf<Scalar>& q,
                                      Pose<Scalar>* poses) {
  require_size(model, q.size(), "q");
  for (std::size_t i = 0; i < model.bodies.size(); ++i) poses[i] = joint_pose(model.bodies[i], q);
}

/// Returns M a + C(q,x) y + g for gravity `gravity`, by one sweep out and one sweep in. Every
/// product of two velocities is symmetrised, so the result is bilinear and symmetric in (x, y).
/// With `two` false x stands for both; with `accelerating` false a is zero.
template <bool two, bool accelerating, class Scalar>
[[gnu::flatten]] VectorOf<Scalar> newton_euler(const Model& model, const Eigen::Vector3d& gravity,
                                               const Pose<Scalar>* poses, const VectorOf<Scalar>& x,
                                               const VectorOf<Scalar>& y,
                                               const VectorOf<Scalar>& a) {
  using Vector3 = Vector3Of<Scalar>;
  require_size(model, x.size(), "v");
  require_size(model, y.size(), "v");
  require_size(model, a.size(), "a");

  BodyState<Scalar>* const state = TACHLESS_PER_BODY(BodyState<Scalar>);
  const std::size_t num_bodies = model.bodies.size();
  for (std::size_t i = 0; i < num_bodies; ++i) {
    const Body& body = model.bodies[i];
    const Pose<Scalar>& X = poses[i];
    BodyState<Scalar>& b = state[i];
    if (body.parent < 0) {
      b.w_x.setZero();
      if constexpr (two) b.w_y.setZero();
      b.alpha.setZero();
      b.acc = X.R.transpose() * Vector3(-gravity.cast<Scalar>());
    } else {
      const BodyState<Scalar>& p = state[static_cast<std::size_t>(body.parent)];
      b.w_x = X.R.transpose() * p.w_x;
      if constexpr (two) b.w_y = X.R.transpose() * p.w_y;
      b.alpha = X.R.transpose() * p.alpha;
      b.acc = X.R.transpose() * p.template acceleration_at<two>(X.p);
    }
    const auto along_axis = [&](const VectorOf<Scalar>& rate) -> Vector3 {
      return body.axis_B * Scalar(body.multiplier * rate[body.coordinate]);
    };
    const Vector3 s_x = along_axis(x);
    Vector3 s_y, turning;  // the product of the parent's turning and the joint's rate
    if constexpr (two) {
      s_y = along_axis(y);
      turning = (b.w_x.cross(s_y) + b.w_y.cross(s_x)) * 0.5;
    } else {
      turning = b.w_x.cross(s_x);
    }
    const bool revolute = body.type == JointType::revolute;
    if (!revolute) turning *= 2.0;
    if constexpr (accelerating) turning = along_axis(a) + turning;
    if (revolute) {
      b.alpha += turning;
      b.w_x += s_x;
      if constexpr (two) b.w_y += s_y;
    } else {
      b.acc += turning;
    }
    const Vector3 c = body.p_Bcm.cast<Scalar>();
    b.n = body.I_Bcm * b.alpha +
          b.template of_velocities<two>([&](const Vector3& from, const Vector3& to) {
            return Vector3(from.cross(Vector3(body.I_Bcm * to)));
          });
    b.f = b.template acceleration_at<two>(c) * body.mass;
    b.n += c.cross(b.f);
  }

  VectorOf<Scalar> tau = VectorOf<Scalar>::Zero(model.num_joints);
  for (std::size_t i = num_bodies; i-- > 0;) {
    const Body& body = model.bodies[i];
    const BodyState<Scalar>& b = state[i];
    tau[body.coordinate] +=
        body.multiplier * component(body.axis_B, body.type == JointType::revolute ? b.n : b.f);
    if (body.parent < 0) continue;
    BodyState<Scalar>& p = state[static_cast<std::size_t>(body.parent)];
    const Vector3 f_P = poses[i].R * b.f;
    p.f += f_P;
    p.n += poses[i].R * b.n + poses[i].p.cross(f_P);
  }
  if (accelerating && model.rotor_inertia.size() != 0) {
    require_size(model, model.rotor_inertia.size(), "rotor_inertia");
    for (int j = 0; j < model.num_joints; ++j) tau[j] += model.rotor_inertia[j] * a[j];
  }
  return tau;
}

/// A body and all bodies that it carries as one rigid body, in the frame of the tree's first body.
template <class Scalar>
struct Composite {
  double mass;
  Vector3Of<Scalar> h;  ///< mass times centre of mass, from the body's origin [kg m]
  Matrix3Of<Scalar> I;  ///< about the body's origin [kg m2]
};

/// Returns a.b 1 - a b': the parallel-axis matrix of the pair (a, b).
template <class Scalar>
Matrix3Of<Scalar> parallel_axis(const Vector3Of<Scalar>& a, const Vector3Of<Scalar>& b) {
  return a.dot(b) * Matrix3Of<Scalar>::Identity() - a * b.transpose();
}

/// Computes M by composite bodies (Featherstone, Rigid Body Dynamics Algorithms, 6.2). An element
/// is the power of one joint's motion on the momentum of another's composite.
template <class Scalar>
[[gnu::flatten]] void set_mass_matrix(const Model& model, const Pose<Scalar>* poses,
                                      MatrixOf<Scalar>& M) {
  using Vector3 = Vector3Of<Scalar>;
  const int num_bodies = static_cast<int>(model.bodies.size());
  // In the frame of the tree's first body, as all below.
  Pose<Scalar>* const X = TACHLESS_PER_BODY(Pose<Scalar>);
  Composite<Scalar>* const composite = TACHLESS_PER_BODY(Composite<Scalar>);
  for (int i = 0; i < num_bodies; ++i) {
    const Body& body = model.bodies[i];
    if (body.parent < 0) {
      X[i] = {Matrix3Of<Scalar>::Identity(), Vector3::Zero()};
    } else {
      X[i] = X[body.parent] * poses[i];
    }
    const Vector3 c = X[i].R * body.p_Bcm.cast<Scalar>();
    const Matrix3Of<Scalar> RI = X[i].R * body.I_Bcm.cast<Scalar>();
    composite[i] = {body.mass, c * body.mass,
                    RI * X[i].R.transpose() + parallel_axis<Scalar>(c, c * body.mass)};
  }
  M.setZero(model.num_joints, model.num_joints);
  // Momenta at unit rate, about the frame's origin.
  Vector3* const linear = TACHLESS_PER_BODY(Vector3);
  Vector3* const angular = TACHLESS_PER_BODY(Vector3);
  int* const carrier = TACHLESS_PER_BODY(int);  // the next body that carries each
  for (int k = num_bodies - 1; k >= 0; --k) {
    const Body& body = model.bodies[k];
    const Composite<Scalar>& b = composite[k];
    const Vector3& p = X[k].p;
    const Vector3 axis = X[k].R * body.axis_B.cast<Scalar>();
    // The joint's motion at unit rate, at the frame's origin.
    Vector3 w = Vector3::Zero(), v = axis;
    if (body.type == JointType::revolute) {
      w = axis;
      v = p.cross(axis);
      linear[k] = axis.cross(b.h);
      angular[k] = b.I * axis + p.cross(linear[k]);
    } else {
      linear[k] = b.mass * axis;
      angular[k] = b.h.cross(axis) + p.cross(linear[k]);
    }
    carrier[k] = k;
    for (int i = num_bodies - 1; i >= k; --i) {
      if (carrier[i] != k) continue;
      carrier[i] = body.parent;
      const Scalar element = (model.bodies[i].multiplier * body.multiplier) *
                             (component(w, angular[i]) + component(v, linear[i]));
      const int row = model.bodies[i].coordinate, col = body.coordinate;
      M(std::max(row, col), std::min(row, col)) += element;
      // Two bodies of one coordinate meet twice on the diagonal.
      if (row == col && i != k) M(row, row) += element;
    }
    if (body.parent < 0) continue;
    Composite<Scalar>& parent = composite[body.parent];
    const Vector3 d = p - X[body.parent].p;
    const Matrix3Of<Scalar> moved = parallel_axis<Scalar>(d, b.h + d * (0.5 * b.mass));
    parent.I += b.I + moved + moved.transpose();
    parent.h += b.h + d * b.mass;
    parent.mass += b.mass;
  }
  M.template triangularView<Eigen::StrictlyUpper>() = M.transpose();
  if (model.rotor_inertia.size() == 0) return;
  require_size(model, model.rotor_inertia.size(), "rotor_inertia");
  M.diagonal() += model.rotor_inertia.cast<Scalar>();
}

/// Computes the joint poses at q, then the same.
template <bool two, class Scalar>
VectorOf<Scalar> newton_euler(const Model& model, const Eigen::Vector3d& gravity,
                              const VectorOf<Scalar>& q, const VectorOf<Scalar>& x,
                              const VectorOf<Scalar>& y, const VectorOf<Scalar>& a) {
  Pose<Scalar>* const poses = TACHLESS_PER_BODY(Pose<Scalar>);
  set_joint_poses(model, q, poses);
  return newton_euler<two, true>(model, gravity, poses, x, y, a);
}

/// Returns C(q,x) y at the joint poses of q.
Vector coriolis_product(const Model& model, const Pose<double>* poses, const Vector& x,
                        const Vector& y) {
  return newton_euler<true, true>(model, Eigen::Vector3d::Zero(), poses, x, y,
                                  Vector(Vector::Zero(model.num_joints)));
}

}  // namespace

template <class Scalar>
VectorOf<Scalar> inverse_dynamics(const Model& model, const VectorOf<Scalar>& q,
                                  const VectorOf<Scalar>& v, const VectorOf<Scalar>& a) {
  return newton_euler<false>(model, model.gravity, q, v, v, a);
}

template <class Scalar>
VectorOf<Scalar> inverse_dynamics_bilinear(const Model& model, const VectorOf<Scalar>& q,
                                           const VectorOf<Scalar>& x, const VectorOf<Scalar>& y,
                                           const VectorOf<Scalar>& a) {
  return newton_euler<true>(model, model.gravity, q, x, y, a);
}

template <class Scalar>
MatrixOf<Scalar> mass_matrix(const Model& model, const VectorOf<Scalar>& q) {
  Pose<Scalar>* const poses = TACHLESS_PER_BODY(Pose<Scalar>);
  set_joint_poses(model, q, poses);
  MatrixOf<Scalar> M;
  set_mass_matrix(model, poses, M);
  return M;
}

Vector coriolis_product(const Model& model, const Vector& q, const Vector& x, const Vector& y) {
  Pose<double>* const poses = TACHLESS_PER_BODY(Pose<double>);
  set_joint_poses(model, q, poses);
  return coriolis_product(model, poses, x, y);
}

Vector gravity_torque(const Model& model, const Vector& q) {
  const Vector rest = Vector::Zero(model.num_joints);
  return newton_euler<false>(model, model.gravity, q, rest, rest, rest);
}

Matrix coriolis_matrix(const Model& model, const Vector& q, const Vector& v) {
  const int n = model.num_joints;
  Pose<double>* const poses = TACHLESS_PER_BODY(Pose<double>);
  set_joint_poses(model, q, poses);
  Matrix C(n, n);
  for (int j = 0; j < n; ++j) C.col(j) = coriolis_product(model, poses, v, Vector::Unit(n, j));
  return C;
}

std::vector<Eigen::MatrixXd> coriolis_matrices(const Model& model, const Vector& q) {
  const int n = model.num_joints;
  Pose<double>* const poses = TACHLESS_PER_BODY(Pose<double>);
  set_joint_poses(model, q, poses);
  std::vector<Eigen::MatrixXd> C(static_cast<std::size_t>(n), Eigen::MatrixXd(n, n));
  for (int j = 0; j < n; ++j) {
    for (int k = 0; k <= j; ++k) {  // C(q, e_j) e_k is C(q, e_k) e_j
      const Vector product = coriolis_product(model, poses, Vector::Unit(n, j), Vector::Unit(n, k));
      C[static_cast<std::size_t>(j)].col(k) = product;
      C[static_cast<std::size_t>(k)].col(j) = product;
    }
  }
  return C;
}

void set_equations_of_motion(const Model& model, const Vector& q, const Vector& v, Matrix& M,
                             Vector& bias) {
  Pose<double>* const poses = TACHLESS_PER_BODY(Pose<double>);
  set_joint_poses(model, q, poses);
  bias = newton_euler<false, false>(model, model.gravity, poses, v, v, v);
  set_mass_matrix(model, poses, M);
}

Vector forward_dynamics(const Model& model, const Vector& q, const Vector& v, const Vector& tau) {
  require_size(model, tau.size(), "tau");
  Matrix M;
  Vector a;
  set_equations_of_motion(model, q, v, M, a);
  for (int j = 0; j < model.num_joints; ++j) a[j] = tau[j] - a[j];
  const int failed = factorise(M);
  if (failed >= 0) {
    throw std::logic_error("robot: the inertia matrix is not positive definite at joint '" +
                           model.joint_names[failed] + "'");
  }
  solve_in_place(M, a);
  return a;
}

template <class Scalar>
Scalar potential_energy(const Model& model, const VectorOf<Scalar>& q) {
  require_size(model, q.size(), "q");
  Pose<Scalar>* const pose = TACHLESS_PER_BODY(Pose<Scalar>);
  Scalar energy = Scalar(0);
  for (std::size_t i = 0; i < model.bodies.size(); ++i) {
    const Body& body = model.bodies[i];
    const Pose<Scalar> joint = joint_pose(body, q);
    pose[i] = body.parent < 0 ? joint : pose[body.parent] * joint;
    const Vector3Of<Scalar> p_cm = pose[i].R * body.p_Bcm + pose[i].p;
    for (int k = 0; k < 3; ++k) energy -= (body.mass * model.gravity[k]) * p_cm[k];
  }
  return energy;
}

#define TACHLESS_DYNAMICS(Scalar)                                                               \
  template VectorOf<Scalar> inverse_dynamics(const Model&, const VectorOf<Scalar>&,             \
                                             const VectorOf<Scalar>&, const VectorOf<Scalar>&); \
  template VectorOf<Scalar> inverse_dynamics_bilinear(                                          \
      const Model&, const VectorOf<Scalar>&, const VectorOf<Scalar>&, const VectorOf<Scalar>&,  \
      const VectorOf<Scalar>&);                                                                 \
  template MatrixOf<Scalar> mass_matrix(const Model&, const VectorOf<Scalar>&);                 \
  template Scalar potential_energy(const Model&, const VectorOf<Scalar>&);
TACHLESS_DYNAMICS(double)
TACHLESS_DYNAMICS(Jet2)

}  // namespace tachless::robot

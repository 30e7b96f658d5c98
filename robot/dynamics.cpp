#include "robot/dynamics.h"

#include <stdexcept>
#include <utility>

#include "robot/cholesky.h"
#include "robot/joint_frames.h"
#include "robot/kinematics.h"

namespace tachless::robot {
namespace {

/// What the recursion keeps of each body, in the body's own frame. Left uninitialised: only the
/// model's bodies are touched.
template <class Scalar>
struct BodyState {
  Triple<Scalar> w_x, w_y;  ///< angular velocity under x and under y
  Triple<Scalar> alpha;     ///< angular acceleration
  Triple<Scalar> acc;       ///< acceleration of the origin, less gravity
  Triple<Scalar> f, n;      ///< force on the body through its joint, moment about the origin
};

/// Acceleration of a body's point r.
template <bool two, class Scalar, class Point>
TACHLESS_INLINE Triple<Scalar> acceleration_at(const BodyState<Scalar>& b, const Triple<Point>& r) {
  if constexpr (two) {
    return b.acc + cross(b.alpha, r) +
           (cross(b.w_x, cross(b.w_y, r)) + cross(b.w_y, cross(b.w_x, r))) * 0.5;
  } else {
    const auto lever = cross(pair(b.alpha, b.w_x), r);
    return b.acc + part<0>(lever) + cross(b.w_x, part<1>(lever));
  }
}

/// What a body's inertia asks of its joint: `b.f` and `b.n` from the motion of `b`.
template <bool two, class Scalar>
TACHLESS_INLINE void set_force(const Body& body, BodyState<Scalar>& b) {
  const Triple<double> c = triple(body.p_Bcm);
  const Turn<double> I = turn(body.I_Bcm);
  if constexpr (two) {
    b.n = I * b.alpha + (cross(b.w_x, I * b.w_y) + cross(b.w_y, I * b.w_x)) * 0.5;
    b.f = acceleration_at<true>(b, c) * body.mass;
  } else {
    const auto turning = pair(b.alpha, b.w_x);
    const auto moment = I * turning;
    const auto lever = cross(turning, c);
    // Of the angular velocity with lever and angular momentum.
    const auto product = cross(b.w_x, pair(part<1>(lever), part<1>(moment)));
    b.n = part<0>(moment) + part<1>(product);
    b.f = (b.acc + part<0>(lever) + part<0>(product)) * body.mass;
  }
  b.n += cross(c, b.f);
}

/// The sweep in: joint forces from those on the bodies. What a body hands to its parent is added to
/// the parent's.
template <class Scalar>
TACHLESS_INLINE void joint_forces(const Model& model, const JointFrame<Scalar>* frames,
                                  BodyState<Scalar>* state, VectorOf<Scalar>& tau) {
  tau.setZero();
  for (int i = static_cast<int>(model.bodies.size()) - 1; i >= 0; --i) {
    const Body& body = model.bodies[i];
    const BodyState<Scalar>& b = state[i];
    const Triple<Scalar>& along = body.type == JointType::revolute ? b.n : b.f;
    const Scalar tau_tree =
        body.axis_B[0] * along.x + body.axis_B[1] * along.y + body.axis_B[2] * along.z;
    tau[body.coordinate] += body.multiplier * tau_tree;
    if (body.parent >= 0) {
      BodyState<Scalar>& p = state[body.parent];
      const JointFrame<Scalar>& X = frames[i];
      const auto both = X.R * pair(b.f, b.n);
      const Triple<Scalar> f_P = part<0>(both);
      p.f += f_P;
      p.n += part<1>(both) + cross(X.p, f_P);
    }
  }
}

/// M a + C(q,x) y + g for gravity `gravity`, by one sweep out and one sweep in. Every product of
/// two velocities is symmetrised, which makes the result bilinear and symmetric in (x, y); with
/// `two` false x stands for both, and with `accelerating` false a is zero.
template <bool two, bool accelerating, class Scalar>
VectorOf<Scalar> newton_euler(const Model& model, const Eigen::Vector3d& gravity,
                              const JointFrame<Scalar>* frames, const VectorOf<Scalar>& x,
                              const VectorOf<Scalar>& y, const VectorOf<Scalar>& a) {
  require_size(model, x.size(), "v");
  require_size(model, y.size(), "v");
  require_size(model, a.size(), "a");

  BodyState<Scalar> state[max_bodies];
  const int num_bodies = static_cast<int>(model.bodies.size());
  for (int i = 0; i < num_bodies; ++i) {
    const Body& body = model.bodies[i];
    BodyState<Scalar>& b = state[i];
    const JointFrame<Scalar>& X = frames[i];
    const Triple<double> axis = triple(body.axis_B);
    if (body.parent < 0) {
      b.w_x = b.w_y = b.alpha = zero_triple<Scalar>();
      b.acc = turned_back(X.R, Triple<double>{-gravity[0], -gravity[1], -gravity[2]});
    } else {
      const BodyState<Scalar>& p = state[body.parent];
      const auto turning = turned_back(X.R, pair(p.w_x, p.alpha));
      b.w_x = part<0>(turning);
      b.alpha = part<1>(turning);
      if constexpr (two) b.w_y = turned_back(X.R, p.w_y);
      b.acc = turned_back(X.R, acceleration_at<two>(p, X.p));
    }
    const Triple<Scalar> s_x = axis * (body.multiplier * x[body.coordinate]);
    Triple<Scalar> s_y, turning;  // the product of the parent's turning and the joint's rate
    if constexpr (two) {
      s_y = axis * (body.multiplier * y[body.coordinate]);
      turning = (cross(b.w_x, s_y) + cross(b.w_y, s_x)) * 0.5;
    } else {
      turning = cross(b.w_x, s_x);
    }
    const bool revolute = body.type == JointType::revolute;
    if (!revolute) turning = turning * 2.0;
    if constexpr (accelerating) turning = axis * (body.multiplier * a[body.coordinate]) + turning;
    if (revolute) {
      b.alpha += turning;
      b.w_x += s_x;
      if constexpr (two) b.w_y += s_y;
    } else {
      b.acc += turning;
    }
    set_force<two>(body, b);
  }

  VectorOf<Scalar> tau(model.num_joints);
  joint_forces(model, frames, state, tau);
  if (accelerating && model.rotor_inertia.size() != 0) {
    require_size(model, model.rotor_inertia.size(), "rotor_inertia");
    for (int j = 0; j < model.num_joints; ++j) tau[j] += model.rotor_inertia[j] * a[j];
  }
  return tau;
}

/// The same at joint positions.
template <bool two, class Scalar>
VectorOf<Scalar> newton_euler(const Model& model, const Eigen::Vector3d& gravity,
                              const VectorOf<Scalar>& q, const VectorOf<Scalar>& x,
                              const VectorOf<Scalar>& y, const VectorOf<Scalar>& a) {
  JointFrame<Scalar> frames[max_bodies];
  set_joint_frames(model, q, frames);
  return newton_euler<two, true>(model, gravity, frames, x, y, a);
}

/// Of M a + bias = tau.
template <class Scalar>
TACHLESS_INLINE void evaluate(const Model& model, const VectorOf<Scalar>& q,
                              const VectorOf<Scalar>& v, MatrixOf<Scalar>& M,
                              VectorOf<Scalar>& bias, const ModelConstants* constants) {
  JointFrame<Scalar> frames[max_bodies];
  set_joint_frames(model, q, frames, constants);
  bias = newton_euler<false, false>(model, model.gravity, frames, v, v, v);
  set_mass_matrix(model, frames, M, constants);
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
VectorOf<Scalar> coriolis_product(const Model& model, const VectorOf<Scalar>& q,
                                  const VectorOf<Scalar>& x, const VectorOf<Scalar>& y) {
  return newton_euler<true, Scalar>(model, Eigen::Vector3d::Zero(), q, x, y,
                                    VectorOf<Scalar>::Zero(model.num_joints));
}

template <class Scalar>
VectorOf<Scalar> gravity_torque(const Model& model, const VectorOf<Scalar>& q) {
  const VectorOf<Scalar> rest = VectorOf<Scalar>::Zero(model.num_joints);
  return newton_euler<false>(model, model.gravity, q, rest, rest, rest);
}

template <class Scalar>
MatrixOf<Scalar> coriolis_matrix(const Model& model, const VectorOf<Scalar>& q,
                                 const VectorOf<Scalar>& v) {
  MatrixOf<Scalar> C(model.num_joints, model.num_joints);
  VectorOf<Scalar> e = VectorOf<Scalar>::Zero(model.num_joints);
  for (int j = 0; j < model.num_joints; ++j) {
    e[j] = Scalar(1);
    C.col(j) = coriolis_product(model, q, v, e);
    e[j] = Scalar(0);
  }
  return C;
}

EquationsOfMotion::EquationsOfMotion(Model model)
    : model_(std::move(model)), constants_(std::make_unique<ModelConstants>(model_)) {}
EquationsOfMotion::~EquationsOfMotion() = default;

void EquationsOfMotion::evaluate(const Vector& q, const Vector& v) {
  robot::evaluate(model_, q, v, M, bias, constants_.get());
}

template <class Scalar>
VectorOf<Scalar> forward_dynamics(const Model& model, const VectorOf<Scalar>& q,
                                  const VectorOf<Scalar>& v, const VectorOf<Scalar>& tau) {
  require_size(model, tau.size(), "tau");
  MatrixOf<Scalar> M;
  VectorOf<Scalar> a;
  evaluate(model, q, v, M, a, nullptr);
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

#define TACHLESS_DYNAMICS(Scalar)                                                                 \
  template VectorOf<Scalar> inverse_dynamics(const Model&, const VectorOf<Scalar>&,               \
                                             const VectorOf<Scalar>&, const VectorOf<Scalar>&);   \
  template VectorOf<Scalar> inverse_dynamics_bilinear(                                            \
      const Model&, const VectorOf<Scalar>&, const VectorOf<Scalar>&, const VectorOf<Scalar>&,    \
      const VectorOf<Scalar>&);                                                                   \
  template VectorOf<Scalar> coriolis_product(const Model&, const VectorOf<Scalar>&,               \
                                             const VectorOf<Scalar>&, const VectorOf<Scalar>&);   \
  template VectorOf<Scalar> gravity_torque(const Model&, const VectorOf<Scalar>&);                \
  template MatrixOf<Scalar> coriolis_matrix(const Model&, const VectorOf<Scalar>&,                \
                                            const VectorOf<Scalar>&);                             \
  template VectorOf<Scalar> forward_dynamics(const Model&, const VectorOf<Scalar>&,               \
                                             const VectorOf<Scalar>&, const VectorOf<Scalar>&);   \
  template Scalar kinetic_energy(const Model&, const VectorOf<Scalar>&, const VectorOf<Scalar>&); \
  template Scalar potential_energy(const Model&, const VectorOf<Scalar>&);
TACHLESS_DYNAMICS(double)
TACHLESS_DYNAMICS(Jet2)

}  // namespace tachless::robot

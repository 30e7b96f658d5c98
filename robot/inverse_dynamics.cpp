#include "robot/inverse_dynamics.h"

#include "robot/kinematics.h"

namespace tachless::robot {
namespace {

/// What the recursion keeps of each body, in the body's own frame. Left uninitialised: only the
/// model's bodies are touched.
template <class Scalar>
struct BodyState {
  Pose<Scalar> X_PB;
  Vector3Of<Scalar> w_x, w_y;  ///< angular velocity under x and under y
  Vector3Of<Scalar> alpha;     ///< angular acceleration
  Vector3Of<Scalar> acc;       ///< acceleration of the origin, less gravity
  Vector3Of<Scalar> f, n;      ///< force on the body through its joint, moment about the origin
};

/// What a body's inertia asks of its joint: `b.f` and `b.n` from the motion of `b`.
template <bool two, class Scalar>
void set_force(const Body& body, BodyState<Scalar>& b) {
  using Vector3 = Vector3Of<Scalar>;
  const Eigen::Vector3d& c_d = body.p_Bcm;
  const Vector3 c = c_d.cast<Scalar>();
  const Eigen::Matrix3d& I = body.I_Bcm;
  Vector3 acc_cm = b.acc + b.alpha.cross(c);
  b.n = I * b.alpha;
  if constexpr (two) {
    acc_cm += 0.5 * (b.w_x.cross(b.w_y.cross(c)) + b.w_y.cross(b.w_x.cross(c)));
    const Vector3 L_x = I * b.w_x;
    const Vector3 L_y = I * b.w_y;
    b.n += 0.5 * (b.w_x.cross(L_y) + b.w_y.cross(L_x));
  } else {
    acc_cm += b.w_x.cross(b.w_x.cross(c));
    const Vector3 L_x = I * b.w_x;
    b.n += b.w_x.cross(L_x);
  }
  b.f = acc_cm * body.mass;
  b.n += c.cross(b.f);
}

/// The sweep in: joint forces from those on the bodies. What a body hands to its parent is added to
/// the parent's.
template <class Scalar>
VectorOf<Scalar> joint_forces(const Model& model, BodyState<Scalar>* state) {
  VectorOf<Scalar> tau(model.num_joints);
  for (int j = 0; j < model.num_joints; ++j) tau[j] = Scalar(0);
  for (int i = static_cast<int>(model.bodies.size()) - 1; i >= 0; --i) {
    const Body& body = model.bodies[i];
    const BodyState<Scalar>& b = state[i];
    const Vector3Of<Scalar>& along = body.type == JointType::revolute ? b.n : b.f;
    const Scalar tau_tree =
        body.axis_B[0] * along[0] + body.axis_B[1] * along[1] + body.axis_B[2] * along[2];
    tau[body.coordinate] += body.multiplier * tau_tree;
    if (body.parent >= 0) {
      BodyState<Scalar>& p = state[body.parent];
      const Vector3Of<Scalar> f_P = b.X_PB.R * b.f;
      p.f += f_P;
      p.n += b.X_PB.R * b.n + b.X_PB.p.cross(f_P);
    }
  }
  return tau;
}

/// M a + C(q,x) y + g for gravity `gravity`, by one sweep out and one sweep in. Every product of
/// two velocities is symmetrised, which makes the result bilinear and symmetric in (x, y); with
/// `two` false x stands for both.
template <bool two, class Scalar>
VectorOf<Scalar> newton_euler(const Model& model, const Eigen::Vector3d& gravity,
                              const VectorOf<Scalar>& q, const VectorOf<Scalar>& x,
                              const VectorOf<Scalar>& y, const VectorOf<Scalar>& a) {
  using Vector3 = Vector3Of<Scalar>;
  require_size(model, q.size(), "q");
  require_size(model, x.size(), "v");
  require_size(model, y.size(), "v");
  require_size(model, a.size(), "a");

  BodyState<Scalar> state[max_bodies];
  const int num_bodies = static_cast<int>(model.bodies.size());
  for (int i = 0; i < num_bodies; ++i) {
    const Body& body = model.bodies[i];
    BodyState<Scalar>& b = state[i];
    b.X_PB = joint_pose(body, tree_position(body, q));
    const auto R_BP = b.X_PB.R.transpose();
    const Vector3& r = b.X_PB.p;

    Vector3 acc_P;
    if (body.parent < 0) {
      b.w_x.setZero();
      if constexpr (two) b.w_y.setZero();
      b.alpha.setZero();
      acc_P = -gravity.cast<Scalar>();
    } else {
      const BodyState<Scalar>& p = state[body.parent];
      b.w_x = R_BP * p.w_x;
      if constexpr (two) b.w_y = R_BP * p.w_y;
      b.alpha = R_BP * p.alpha;
      acc_P = p.acc + p.alpha.cross(r);
      if constexpr (two) {
        acc_P += 0.5 * (p.w_x.cross(p.w_y.cross(r)) + p.w_y.cross(p.w_x.cross(r)));
      } else {
        acc_P += p.w_x.cross(p.w_x.cross(r));
      }
    }
    b.acc = R_BP * acc_P;

    const Vector3 s_x = scaled<Scalar>(body.axis_B, body.multiplier * x[body.coordinate]);
    const Vector3 s_a = scaled<Scalar>(body.axis_B, body.multiplier * a[body.coordinate]);
    Vector3 s_y, turning;  // the product of the parent's turning and the joint's rate
    if constexpr (two) {
      s_y = scaled<Scalar>(body.axis_B, body.multiplier * y[body.coordinate]);
      turning = 0.5 * (b.w_x.cross(s_y) + b.w_y.cross(s_x));
    } else {
      turning = b.w_x.cross(s_x);
    }
    if (body.type == JointType::revolute) {
      b.alpha += s_a + turning;
      b.w_x += s_x;
      if constexpr (two) b.w_y += s_y;
    } else {
      b.acc += s_a + turning * 2.0;
    }

    set_force<two>(body, b);
  }

  VectorOf<Scalar> tau = joint_forces(model, state);
  if (model.rotor_inertia.size() != 0) {
    require_size(model, model.rotor_inertia.size(), "rotor_inertia");
    for (int j = 0; j < model.num_joints; ++j) tau[j] += model.rotor_inertia[j] * a[j];
  }
  return tau;
}

template <class Scalar>
VectorOf<Scalar> zero(const Model& model) {
  VectorOf<Scalar> x(model.num_joints);
  for (int j = 0; j < model.num_joints; ++j) x[j] = Scalar(0);
  return x;
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
  return newton_euler<true>(model, Eigen::Vector3d::Zero(), q, x, y, zero<Scalar>(model));
}

template <class Scalar>
VectorOf<Scalar> gravity_torque(const Model& model, const VectorOf<Scalar>& q) {
  const VectorOf<Scalar> rest = zero<Scalar>(model);
  return newton_euler<false>(model, model.gravity, q, rest, rest, rest);
}

template <class Scalar>
MatrixOf<Scalar> coriolis_matrix(const Model& model, const VectorOf<Scalar>& q,
                                 const VectorOf<Scalar>& v) {
  MatrixOf<Scalar> C(model.num_joints, model.num_joints);
  VectorOf<Scalar> e = zero<Scalar>(model);
  for (int j = 0; j < model.num_joints; ++j) {
    e[j] = Scalar(1);
    C.col(j) = coriolis_product(model, q, v, e);
    e[j] = Scalar(0);
  }
  return C;
}

TACHLESS_INVERSE_DYNAMICS(, double)
TACHLESS_INVERSE_DYNAMICS(, Jet2)

}  // namespace tachless::robot

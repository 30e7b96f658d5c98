#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "lyapunov/error_system.h"
#include "messages/signals.h"
#include "scenario/scenario.h"

/// A scenario's law in the error coordinates of the certificate, and the friction that disturbs it.
namespace tachless::lyapunov {

/// Error systems and initial state of a scenario's law, for the certificate.
struct LawLoop {
  /// The error systems; the first is the system of the start. Constant gains have one system. Gains
  /// that follow the reference have one system for each examined instant. These are 25 evenly
  /// spaced instants, and the instants where |v_ref| or the rate of Kp has a large maximum.
  std::vector<ErrorSystem> systems;
  Eigen::VectorXd initial;         ///< (e, nu, edot) at t = 0
  std::optional<Weights> weights;  ///< the only weights that a law with an integral allows
  Eigen::VectorXd ki;              ///< gain of the integral [N m/rad]
  Eigen::VectorXd d_max;           ///< largest torque of the integral [N m]; infinite: no bound
  /// Feedback torque up to which the systems describe the law [N m]; empty: any.
  Eigen::VectorXd linear_feedback;
};

/// Returns the error system of a law with filtered errors at a point of the reference. The gains
/// and their rates follow from the law's torques for unit errors.
/// @param D viscous friction of the joints [N m s/rad]
template <class L>
ErrorSystem system_at(const L& law, const messages::ReferencePoint& reference,
                      const Eigen::VectorXd& D) {
  const Eigen::Index n = reference.q_ref.size();
  ErrorSystem s{
      Eigen::MatrixXd(n, n), Eigen::MatrixXd(n, n), law.filter_pole(), law.filter_gain(), {}, D};
  s.kp_dot = s.kd_dot = s.kp;
  const Vector none = Vector::Zero(n);
  for (Eigen::Index j = 0; j < n; ++j) {
    const Vector unit = Vector::Unit(n, j);
    s.kp.col(j) = -law.feedback(none, unit, none, reference);
    s.kd.col(j) = -law.feedback(none, none, unit, reference);
    s.kp_dot.col(j) = law.feedback_rate(unit, none, reference);
    s.kd_dot.col(j) = law.feedback_rate(none, unit, reference);
  }
  s.v_ref = reference.v_ref;
  return s;
}

/// Returns why the scenario's law has no stability certificate, for example a rigid law on flexible
/// joints. Empty: the law has a certificate.
std::string no_certificate(const scenario::Scenario& scenario);

/// Returns the loop of the scenario's law; nothing for a law without a certificate.
/// @throw base::Failure(bad_usage) if law, robot or reference cannot be made of the scenario
std::optional<LawLoop> law_loop(const scenario::Scenario& scenario);

/// Returns the robot model of the error equation. Its M includes the rotors of rigid joints.
robot::Model error_model(const scenario::Scenario& scenario);

/// Returns V [J] of the error state x at posture q.
double lyapunov_value(const ErrorSystem& system, const Weights& weights, const robot::Model& links,
                      const Vector& q, const Eigen::VectorXd& x);

/// Bounds of each joint's |v_ref|, |a_ref|, |jerk_ref| and |snap_ref| at all times.
struct MotionBound {
  Eigen::VectorXd v, a, jerk, snap;
};
/// Returns the bounds by the sums of the sinusoids' amplitudes, or by the polynomials' coefficients
/// in Bernstein's basis.
MotionBound motion_bound(const scenario::Scenario& scenario);

/// Bound of v_ref over the run: the ellipsoid |scale^-1 v_ref| <= 1, and sup |v_ref| of all joints
/// together and of each. The ellipsoid has the axes of the motion's mean square. Each axis is at
/// least a thousandth of the longest.
struct VelocityBound {
  double speed = 0;
  Eigen::VectorXd each;
  Eigen::MatrixXd scale;
};
/// Returns the bound for the scenario's reference.
VelocityBound velocity_bound(const scenario::Scenario& scenario);

/// Bounds of a rigid robot's friction torques, which Mm does not contain. Let f = Fc Sgn(v) + r
/// less Ff tanh(v_ref / s) fed forward, and y = edot + delta. Here |r| <= L - Fc + |F_r| of a fall,
/// with L that of `scenario::largest_friction`, and r has the rise and the load that are fed
/// forward. Then Vdot <= -x' Mm x + |y|' on_y + |delta|' on_delta + power. The term -edot Fc
/// (Sgn(v) - tanh(v_ref / s)) is at most 0.2785 Fc s.
struct FrictionTorques {
  Eigen::VectorXd on_y, on_delta;  ///< [N m]
  double power = 0;                ///< [W]

  [[nodiscard]] bool any() const { return !on_y.isZero(0) || !on_delta.isZero(0); }
};
/// Returns the bounds for a scenario.
/// @param v_ref largest reference speed of each joint [rad/s; m/s]; empty or 0 at a constant
/// reference
FrictionTorques friction_torques(const scenario::Scenario& scenario, const Eigen::VectorXd& v_ref);

}  // namespace tachless::lyapunov

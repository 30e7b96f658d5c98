#pragma once

#include <string_view>
#include <tuple>
#include <type_traits>
#include <utility>

#include "controller/law/law.h"
#include "robot/dynamics.h"
#include "robot/jet.h"
#include "robot/model.h"

/// Parts of laws: their robot, gains and feed-forward. This header declares no law.
namespace tachless::controller::law {

/// Returns the key of a parameter that has to be greater than 0.
template <class Gains, class Member>
constexpr base::Key<Gains, Member> gain(std::string_view name, Member Gains::*member,
                                        std::string_view unit, std::string_view meaning) {
  return base::Key{name, member, unit, meaning}.in(base::positive);
}

/// Gains of a law that commands -Kp e - Kd edot, one of each per joint.
struct PdGains {
  Vector kp;  ///< [N m/rad]
  Vector kd;  ///< [N m s/rad]

  static constexpr std::tuple keys{
      gain("kp", &PdGains::kp, "N m/rad", "Weight of the position error"),
      gain("kd", &PdGains::kd, "N m s/rad", "Weight of the velocity error")};
};

/// Gains of the laws that command -Kp e - Kd nu, one of each per joint. The filter nudot = -A nu +
/// B edot replaces the velocity error.
struct FilterGains {
  Vector kp;  ///< [N m/rad]
  Vector kd;  ///< [N m s/rad]
  Vector a;   ///< pole [1/s]
  Vector b;   ///< gain [1/s]

  static constexpr std::tuple keys{
      gain("kp", &FilterGains::kp, "N m/rad", "Weight of the position error"),
      gain("kd", &FilterGains::kd, "N m s/rad", "Weight of the filter output"),
      gain("a", &FilterGains::a, "1/s", "Filter pole"),
      gain("b", &FilterGains::b, "1/s", "Filter gain")};
};

/// A law's model of a robot with motors behind springs (paper, eq. 1; Spong's simplified model):
/// M_l(q) vdot + C(q,v) v + g(q) = K (theta - q), J thetaddot + K (theta - q) = tau. Eq. 1 has no
/// motor damping, so the model has none.
struct FlexibleRobot {
  robot::Model links;    ///< link side: M_l, without rotor inertia
  Vector stiffness;      ///< K [N m/rad], > 0
  Vector rotor_inertia;  ///< J [kg m2], on the link side of the gear, > 0

  /// Returns K (theta - q), the torque of the springs on the links [N m].
  [[nodiscard]] Vector spring_torque(const Vector& q, const Vector& theta) const {
    return stiffness.cwiseProduct(theta - q);
  }
};

/// v_ref and vdot_ref of a feed-forward.
struct Feedforward {
  Vector v_ref;  ///< [rad/s]
  Vector a_ref;  ///< [rad/s^2]
};

/// Returns the reference's velocity and acceleration `lead_s` ahead, by Taylor expansion through
/// snap. A torque held over a tick acts late, on average by half a tick plus the command's delay. A
/// feed-forward that is evaluated ahead by this time compensates the delay. Position, error and
/// filter are not taken ahead, because they refer to the measurement.
inline Feedforward feedforward_ahead(const ReferencePoint& reference, double lead_s) {
  const double h = lead_s;
  return {reference.v_ref +
              h * (reference.a_ref + h / 2 * (reference.jerk_ref + h / 3 * reference.snap_ref)),
          reference.a_ref + h * (reference.jerk_ref + h / 2 * reference.snap_ref)};
}

/// Returns the friction that is fed forward at the reference, `lead_s` ahead [N m; N]. The load on
/// a joint is taken at q_ref itself.
/// @param robot the law's model
inline Vector friction_feedforward(const FrictionSpec& friction, const robot::Model& robot,
                                   const ReferencePoint& reference, double lead_s) {
  return friction.torque(
      feedforward_ahead(reference, lead_s).v_ref,
      friction.needs_gravity() ? robot::gravity_torque(robot, reference.q_ref) : Vector());
}

/// Position, velocity and acceleration of the reference, each with its first two time derivatives.
struct ReferenceJets {
  robot::JetVector q;  ///< [rad; m]
  robot::JetVector v;  ///< [rad/s; m/s]
  robot::JetVector a;  ///< [rad/s^2; m/s^2]

  /// Computes the jets at the instant of `r`.
  explicit ReferenceJets(const ReferencePoint& r)
      : q(robot::jet(r.q_ref, r.v_ref, r.a_ref)),
        v(robot::jet(r.v_ref, r.a_ref, r.jerk_ref)),
        a(robot::jet(r.a_ref, r.jerk_ref, r.snap_ref)) {}
};

/// Returns ID(q_ref, v_ref, vdot_ref) of the links with its first two time derivatives [N m]. The
/// result is exact, because the reference is given up to snap.
inline robot::JetVector feedforward_torque(const robot::Model& links,
                                           const ReferencePoint& reference) {
  const ReferenceJets r(reference);
  return robot::inverse_dynamics(links, r.q, r.v, r.a);
}

/// Base of the laws: robot, gains and settings of one law, and the declarations that most laws
/// share.
template <class R, class G>
class LawOf {
 public:
  using Robot = R;  ///< model; for rigid joints M = M_l + J with the rotor inertia
  using Gains = G;  ///< declares `keys`

  static constexpr bool regulation_only = false;  ///< follows any reference
  /// Laws for flexible joints have no lead: they differentiate their feed-forward twice, so a lead
  /// would need derivatives beyond snap.
  static constexpr bool has_feedforward_lead = std::is_same_v<Robot, robot::Model>;

  /// @param gains with one entry per joint, like the robot.
  LawOf(Robot robot, Gains gains, const Settings& settings)
      : robot_(std::move(robot)), gains_(std::move(gains)), settings_(settings) {}

 protected:
  /// Returns a filter with the discretisation, start and period of the settings; a, b [1/s].
  [[nodiscard]] Filter filter(const Vector& a, const Vector& b) const {
    return {a, b, settings_.filter, settings_.filter_start, settings_.period_s};
  }
  /// Returns a parameter's value for each joint.
  [[nodiscard]] static const Vector& each(const Vector& value) { return value; }
  /// Returns a vector with `value` for each joint.
  [[nodiscard]] Vector each(double value) const {
    return Vector::Constant(robot_.num_joints, value);
  }
  /// Returns v_ref and vdot_ref, taken ahead by the scenario's `feedforward_lead_s`.
  [[nodiscard]] Feedforward ahead(const ReferencePoint& reference) const {
    return feedforward_ahead(reference, settings_.feedforward_lead_s);
  }

  /// Returns the friction that the law itself feeds forward [N m; N].
  [[nodiscard]] Vector friction(const ReferencePoint& reference) const {
    return friction_feedforward(settings_.friction, robot_, reference,
                                settings_.feedforward_lead_s);
  }

  Robot robot_;        ///< the law's model of the robot
  Gains gains_;        ///< parameters of the law
  Settings settings_;  ///< sampling
};

/// Base of the laws for rigid joints.
template <class Gains>
using RigidLaw = LawOf<robot::Model, Gains>;
/// Base of the laws for motors behind springs.
template <class Gains>
using FlexibleLaw = LawOf<FlexibleRobot, Gains>;

/// Base of the laws that measure the full state and keep nothing from one tick to the next.
struct FullState {
  using Measurement = messages::StateMeasurement;  ///< full state
  struct Memory {};

  /// Returns the empty memory.
  [[nodiscard]] static Memory start(const Measurement& /*measurement*/,
                                    const ReferencePoint& /*reference*/) {
    return {};
  }
};

/// Returns x' diag(d) x.
inline double weighted(const Vector& d, const Vector& x) { return x.dot(d.cwiseProduct(x)); }

/// Returns eq. 15 of Loria and Ortega (1995) for a rigid robot with weights of each error [J]: 1/2
/// edot' M edot + 1/2 e' Kp e + 1/2 nu' Kd B^-1 nu + (eps_1 e - eps_2 nu)' M edot.
/// @param momentum M edot
/// @param spring Kp e
/// @param damper Kd B^-1 nu
/// @param begin index of the weights of the first of these errors
inline double equation_15(const Vector& e, const Vector& edot, const Vector& nu,
                          const Vector& momentum, const Vector& spring, const Vector& damper,
                          const LyapunovWeights& weights, Eigen::Index begin = 0) {
  const auto [eps_1, eps_2] = weights.of(e.size(), begin);
  return 0.5 * edot.dot(momentum) + 0.5 * e.dot(spring) + 0.5 * nu.dot(damper) +
         (eps_1.cwiseProduct(e) - eps_2.cwiseProduct(nu)).dot(momentum);
}

}  // namespace tachless::controller::law

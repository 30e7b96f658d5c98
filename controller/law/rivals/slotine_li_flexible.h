#pragma once

#include <array>
#include <string_view>
#include <tuple>

#include "controller/law/parts.h"
#include "robot/dynamics.h"

namespace tachless::controller::law {

struct SlotineLiFlexibleGains {
  Vector lambda, ks1, ks2;

  static constexpr std::tuple keys{
      gain("lambda", &SlotineLiFlexibleGains::lambda, "1/s",
           "Weight of a position error in s = edot + lambda e; the same on link and motor"),
      gain("ks1", &SlotineLiFlexibleGains::ks1, "N m s/rad", "Weight of the link's s"),
      gain("ks2", &SlotineLiFlexibleGains::ks2, "N m s/rad", "Weight of the motor's s")};
};

/// Tracking of a robot with flexible joints from the full state and link jerk. It is the
/// passivity-based law of Lozano and Brogliato (1992-1995), in the form implemented here:
///
///   theta_ref = q_ref + K^-1 [ M v_rdot + C(q, v) v_r + g - Ks1 s1 ],  v_r = v_ref - Lambda e1,
///   tau = J thetaddot_r + K (theta_ref - q_ref) - Ks2 s2,  thetadot_r = thetadot_ref - Lambda e2,
///   s1 = v - v_r,  s2 = thetadot - thetadot_r,  e1 = q - q_ref,  e2 = theta - theta_ref.
///
/// Unlike `LoriaOrtegaFlexible`, theta_ref contains link velocity, so its second derivative
/// contains link jerk. The law computes link jerk from the model and from motor velocity.
class SlotineLiFlexible : public FlexibleLaw<SlotineLiFlexibleGains>, public FullState {
 public:
  static constexpr std::string_view name = "slotine_li_flexible";
  static constexpr std::array signals{Signal{"error_1", "rad"}, Signal{"edot_1", "rad/s"},
                                      Signal{"error_2", "rad"},
                                      Signal{"edot_2", "rad/s"}};  ///< 1: link, 2: motor
  static constexpr std::string_view source =
      "R. Lozano and B. Brogliato, 1992-1995 (passivity-based control of flexible joints), in the "
      "form implemented here";
  static constexpr std::string_view proved = "globally exponentially stable, in continuous time";
  static constexpr std::string_view conditions =
      "any positive gains, the same diagonal Lambda on links and motors; a reference that is four "
      "times continuously differentiable";

  using LawOf::LawOf;

  static Gains tuned(const Tuning& t) {
    return {t.each(t.w / t.damping), t.damping * t.w * t.inertia, t.motor_kd()};
  }

  [[nodiscard]] Step<Memory> step(const Memory& /*memory*/, const Measurement& measured,
                                  const ReferencePoint& reference) const {
    const robot::JetVector theta_ref = motor_reference(measured, reference);
    const Vector e2 = measured.theta - robot::value(theta_ref);
    const Vector e2dot = measured.thetadot - robot::first_derivative(theta_ref);
    const Vector s2 = e2dot + gains_.lambda.cwiseProduct(e2);
    const Vector thetaddot_r =
        robot::second_derivative(theta_ref) - gains_.lambda.cwiseProduct(e2dot);
    const Vector tau = robot_.rotor_inertia.cwiseProduct(thetaddot_r) +
                       robot_.spring_torque(reference.q_ref, robot::value(theta_ref)) -
                       gains_.ks2.cwiseProduct(s2);
    return {
        {},
        {tau},
        {signals.size(), {measured.q - reference.q_ref, measured.v - reference.v_ref, e2, e2dot}}};
  }

  /// Returns link jerk by the model [rad/s^3]: the first line of eq. 1, differentiated once.
  [[nodiscard]] Vector link_jerk(const Measurement& measured, const Vector& vdot) const {
    const Vector& q = measured.q;
    const Vector& v = measured.v;
    const Vector zero = Vector::Zero(q.size());
    // d/dt ID(q, v, vdot) = M jerk + rest; rest is the derivative with jerk set to zero.
    const Vector rest = robot::first_derivative(
        robot::inverse_dynamics(robot_.links, robot::jet(q, v, vdot), robot::jet(v, vdot, zero),
                                robot::jet(vdot, zero, zero)));
    const Vector spring_rate = robot_.spring_torque(v, measured.thetadot);
    // M^-1 x equals forward dynamics at rest under x + g.
    return robot::forward_dynamics(
        robot_.links, q, zero, Vector(spring_rate - rest + robot::gravity_torque(robot_.links, q)));
  }

  /// Returns theta_ref [rad] with its first and second time derivative.
  [[nodiscard]] robot::JetVector motor_reference(const Measurement& measured,
                                                 const ReferencePoint& reference) const {
    const Vector vdot = robot::forward_dynamics(robot_.links, measured.q, measured.v,
                                                robot_.spring_torque(measured.q, measured.theta));
    const robot::JetVector q = robot::jet(measured.q, measured.v, vdot);
    const robot::JetVector v = robot::jet(measured.v, vdot, link_jerk(measured, vdot));
    const ReferenceJets r(reference);
    const robot::JetVector v_r = r.v - (q - r.q).cwiseProduct(gains_.lambda);
    const robot::JetVector a_r = r.a - (v - r.v).cwiseProduct(gains_.lambda);
    const robot::JetVector torque = robot::inverse_dynamics_bilinear(robot_.links, q, v, v_r, a_r) -
                                    (v - v_r).cwiseProduct(gains_.ks1);
    return r.q + torque.cwiseQuotient(robot_.stiffness);
  }

  /// Lyapunov function V with Vdot = -s1' Ks1 s1 - s2' Ks2 s2 - (e1 - e2)' Lambda K (e1 - e2).
  static constexpr std::string_view lyapunov_formula =
      "½ s₁′M s₁ + ½ s₂′J s₂ + ½ (e₁ − e₂)′K (e₁ − e₂),  s = ė + Λ e";
  [[nodiscard]] double lyapunov(const LoopState& state, const ReferencePoint& reference,
                                const LyapunovWeights& /*weights*/) const {
    const robot::JetVector theta_ref =
        motor_reference({state.q, state.v, state.theta, state.thetadot}, reference);
    const Vector e1 = state.q - reference.q_ref;
    const Vector e2 = state.theta - robot::value(theta_ref);
    const Vector s1 = state.v - reference.v_ref + gains_.lambda.cwiseProduct(e1);
    const Vector s2 =
        state.thetadot - robot::first_derivative(theta_ref) + gains_.lambda.cwiseProduct(e2);
    return 0.5 * s1.dot(robot::mass_matrix(robot_.links, state.q) * s1) +
           0.5 * weighted(robot_.rotor_inertia, s2) + 0.5 * weighted(robot_.stiffness, e1 - e2);
  }
};

static_assert(Law<SlotineLiFlexible>);
static_assert(!OutputFeedbackLaw<SlotineLiFlexible>);

}  // namespace tachless::controller::law

#pragma once

#include <algorithm>
#include <array>
#include <string_view>
#include <tuple>

#include "controller/law/parts.h"
#include "robot/dynamics.h"

namespace tachless::controller::law {

struct FlexiblePositionGains {
  Vector kp1, kd1, a1, b1;  ///< gains of the link's error
  Vector beta;              ///< gain of the springs' torque
  Vector kd2, a2, b2;       ///< damping of the motors

  using Self = FlexiblePositionGains;
  static constexpr std::tuple keys{
      gain("kp1", &Self::kp1, "N m/rad", "Weight of the link's position error"),
      gain("kd1", &Self::kd1, "N m s/rad", "Weight of the link filter's output"),
      gain("a1", &Self::a1, "1/s", "Link filter's pole"),
      gain("b1", &Self::b1, "1/s", "Link filter's gain"),
      gain("beta", &Self::beta, "1", "Weight of the springs' torque error"),
      gain("kd2", &Self::kd2, "N m s/rad", "Weight of the motor filter's output"),
      gain("a2", &Self::a2, "1/s", "Motor filter's pole"),
      gain("b2", &Self::b2, "1/s", "Motor filter's gain")};
};

/// Tracking of a robot with flexible joints from positions alone: encoders on links and motors, no
/// velocity of either.
///
///   ts = K (theta - q),   t1 = ID_l(q, v_ref, vdot_ref) - Kp1 e1 - Kd1 nu1,   e1 = q - q_ref,
///   theta_d = q_ref + K^-1 ID_l(q_ref, v_ref, vdot_ref),   em = theta - theta_d,
///   tau = ts + beta (t1 - ts) + J thetaddot_d - Kd2 nu2,
///   nu1 = diag{ b1 p / (p + a1) } e1,   nu2 = diag{ b2 p / (p + a2) } em.
///
/// The rigid law of eq. 4 is the set point of a torque loop, which the two encoders close. A filter
/// of the motors' own error damps the motors. theta_d depends on the reference alone. Its second
/// derivative is exact, because the reference is given up to snap. With a lead, v_ref and vdot_ref
/// of t1 are taken ahead; theta_d is not.
class FlexiblePosition : public FlexibleLaw<FlexiblePositionGains> {
 public:
  static constexpr std::string_view name = "flexible_position";
  static constexpr std::array signals{Signal{"error_1", "rad"}, Signal{"nu_1", "rad/s"},
                                      Signal{"error_2", "rad"}, Signal{"nu_2", "rad/s"},
                                      Signal{"torque_error", "N m"}};  ///< 1: link, 2: motor
  static constexpr std::string_view source =
      "derived here from A. Loria and R. Ortega, On tracking control of rigid and flexible joint "
      "robots, Appl. Math. and Comp. Sci. 5(2), 1995, eq. 4-5 and 9-10";
  static constexpr std::string_view proved =
      "semiglobally exponentially stable from positions alone, in continuous time";
  static constexpr std::string_view conditions =
      "the matrix condition of loria_ortega_rigid with M_l, Kp1, Kd1, A1, B1; then sqrt(K beta / "
      "J), common to all joints, with Kd2 B2 A2^-1 and A2 = B2 in proportion to it, large enough; "
      "a reference that is four times continuously differentiable";
  static constexpr bool has_feedforward_lead = true;

  using Measurement = messages::BothPositionsMeasurement;
  struct Memory {
    Filter::Memory link, motor;

    static constexpr std::tuple members{&Memory::link, &Memory::motor};
  };
  using LawOf::LawOf;

  /// Computes gains for the inertia of link and rotor together. The rotor's share of this inertia
  /// decides how much of the damping acts at the motors: damping at light links destabilises heavy
  /// rotors.
  static Gains tuned(const Tuning& t) {
    const Vector felt = t.inertia + t.rotor;
    const Vector at_links = (1 - 2.5 * t.rotor.cwiseQuotient(felt).array()).max(0.02).matrix();
    const Vector damping = 2 * (t.damping * t.w) * felt;
    const Vector of_springs = t.stiffness.cwiseProduct(t.rotor).cwiseSqrt();
    const Vector kd1 = at_links.cwiseProduct(damping);
    const Vector kd2 = (damping - kd1).cwiseMax(at_links.cwiseProduct(of_springs));
    const Vector a1 = t.each(std::min(7 * t.w, t.filter));
    const Vector a2 = t.each(t.filter).cwiseMax(t.resonance());
    return {t.w * t.w * felt, kd1, a1, a1, t.each(1), kd2, a2, a2};
  }

  [[nodiscard]] Memory start(const Measurement& measured, const ReferencePoint& reference) const {
    return {link_filter_.start(measured.q - reference.q_ref),
            motor_filter_.start(measured.theta - robot::value(motor_reference(reference)))};
  }

  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measured,
                                  const ReferencePoint& reference) const {
    const robot::JetVector theta_d = motor_reference(reference);
    const Vector e1 = measured.q - reference.q_ref;
    const Vector em = measured.theta - robot::value(theta_d);
    const Filter::Memory link = link_filter_.step(memory.link, e1);
    const Filter::Memory motor = motor_filter_.step(memory.motor, em);
    const auto [v_ref, a_ref] = ahead(reference);
    const Vector z = robot_.spring_torque(measured.q, measured.theta) -
                     link_torque(measured.q, {v_ref, a_ref}, e1, link.nu);
    const Vector tau = robot_.spring_torque(measured.q, measured.theta) -
                       gains_.beta.cwiseProduct(z) +
                       robot_.rotor_inertia.cwiseProduct(robot::second_derivative(theta_d)) -
                       gains_.kd2.cwiseProduct(motor.nu);
    return {{link, motor}, {tau}, {signals.size(), {e1, link.nu, em, motor.nu, z}}};
  }

  /// Returns theta_d with its first two time derivatives [rad].
  [[nodiscard]] robot::JetVector motor_reference(const ReferencePoint& reference) const {
    return ReferenceJets(reference).q +
           feedforward_torque(robot_.links, reference).cwiseQuotient(robot_.stiffness);
  }

  /// Returns t1, the set point of the springs' torque [N m].
  [[nodiscard]] Vector link_torque(const Vector& q, const Feedforward& ahead, const Vector& e1,
                                   const Vector& nu1) const {
    return robot::inverse_dynamics(robot_.links, q, ahead.v_ref, ahead.a_ref) -
           gains_.kp1.cwiseProduct(e1) - gains_.kd1.cwiseProduct(nu1);
  }

  static constexpr std::string_view lyapunov_formula =
      "½ ė₁′Mė₁ + ½ e₁′Kp₁e₁ + ½ ν₁′Kd₁B₁⁻¹ν₁ + ½ z′K⁻¹z + ½ w′Jβ⁻¹w + ½ ν₂′Kd₂β⁻¹B₂⁻¹ν₂";
  /// Returns the sum of the energies of links, springs, motors and filters [J], with z = ts - t1
  /// and w = thetadot - theta_ddot. This sum is the Lyapunov function of the proof without the
  /// cross terms.
  [[nodiscard]] double lyapunov(const LoopState& state, const ReferencePoint& reference,
                                const LyapunovWeights& /*weights*/) const {
    const Vector e1 = state.q - reference.q_ref, e1dot = state.v - reference.v_ref;
    const Vector& nu1 = state.controller.value[1];
    const Vector& nu2 = state.controller.value[3];
    const Vector w = state.thetadot - robot::first_derivative(motor_reference(reference));
    const Vector z = robot_.spring_torque(state.q, state.theta) -
                     link_torque(state.q, {reference.v_ref, reference.a_ref}, e1, nu1);
    return 0.5 * (e1dot.dot(robot::mass_matrix(robot_.links, state.q) * e1dot) +
                  weighted(gains_.kp1, e1) + weighted(gains_.kd1.cwiseQuotient(gains_.b1), nu1) +
                  weighted(robot_.stiffness.cwiseInverse(), z) +
                  weighted(robot_.rotor_inertia.cwiseQuotient(gains_.beta), w) +
                  weighted(gains_.kd2.cwiseQuotient(gains_.beta.cwiseProduct(gains_.b2)), nu2));
  }

 private:
  Filter link_filter_ = filter(gains_.a1, gains_.b1);
  Filter motor_filter_ = filter(gains_.a2, gains_.b2);
};

static_assert(OutputFeedbackLaw<FlexiblePosition>);

}  // namespace tachless::controller::law

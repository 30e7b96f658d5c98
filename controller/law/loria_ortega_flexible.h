#pragma once

#include <array>
#include <string_view>
#include <tuple>

#include "controller/law/parts.h"
#include "robot/dynamics.h"

namespace tachless::controller::law {

struct LoriaOrtegaFlexibleGains {
  Vector kp1, kd1, a1, b1;  ///< gains of the link's error
  Vector kp2, kd2, a2, b2;  ///< gains of the motor's error

  using Self = LoriaOrtegaFlexibleGains;
  static constexpr std::tuple keys{
      gain("kp1", &Self::kp1, "N m/rad", "Weight of the link's position error"),
      gain("kd1", &Self::kd1, "N m s/rad", "Weight of the link filter's output"),
      gain("a1", &Self::a1, "1/s", "Link filter's pole"),
      gain("b1", &Self::b1, "1/s", "Link filter's gain"),
      gain("kp2", &Self::kp2, "N m/rad", "Weight of the motor's position error"),
      gain("kd2", &Self::kd2, "N m s/rad", "Weight of the motor filter's output"),
      gain("a2", &Self::a2, "1/s", "Motor filter's pole"),
      gain("b2", &Self::b2, "1/s", "Motor filter's gain")};
};

/// Tracking of a robot with flexible joints without link jerk (`source`):
///
///   theta_ref = q_ref + K^-1 [ ID_l(q, v_ref, vdot_ref) - Kp1 e1 - Kd1 nu1 ],
///   tau = J thetaddot_ref + K (theta_ref - q_ref) - Kp2 e2 - Kd2 nu2,
///   nu_j = diag{ b_j p / (p + a_j) } e_j,   e1 = q - q_ref,   e2 = theta - theta_ref.
///
/// thetaddot_ref is exact. The inverse dynamics are evaluated with jets (value, first and second
/// time derivative). Forward dynamics of the first line of eq. 1 give the second derivative of q.
/// The continuous filter's equations give nu1dot = -A1 nu1 + B1 e1dot and nu1ddot = -A1 nu1dot + B1
/// e1ddot at the sampled filter's output. The law uses the reference's derivatives up to snap.
///
/// The law uses neither motor velocity nor measured link jerk.
class LoriaOrtegaFlexible : public FlexibleLaw<LoriaOrtegaFlexibleGains> {
 public:
  static constexpr std::string_view name = "loria_ortega_flexible";
  static constexpr std::array signals{Signal{"error_1", "rad"}, Signal{"nu_1", "rad/s"},
                                      Signal{"error_2", "rad"},
                                      Signal{"nu_2", "rad/s"}};  ///< 1: link, 2: motor
  static constexpr std::string_view source =
      "A. Loria and R. Ortega, On tracking control of rigid and flexible joint robots, Appl. Math. "
      "and Comp. Sci. 5(2), 1995, eq. 9-12 and Prop. 2";
  static constexpr std::string_view proved =
      "exponentially stable, semiglobally in error coordinates, in continuous time";
  static constexpr std::string_view conditions =
      "each b_i > L(D) / (beta_2 l(D)) with D = blockdiag(M_l, J) (12), and the conditions of "
      "loria_ortega_rigid on eps with this D, Kp = [Kp1 + K, -K; -K, Kp2 + K] and block diagonal "
      "Kd, A, B; a reference that is four times continuously differentiable";

  using Measurement = messages::LinkStateMeasurement;
  struct Memory {
    Filter::Memory link, motor;

    static constexpr std::tuple members{&Memory::link, &Memory::motor};
  };
  using LawOf::LawOf;

  /// Computes gains whose motor part damps the motors' resonance and leaves the stiffness to the
  /// springs.
  static Gains tuned(const Tuning& t) {
    const Vector motor_filter = 3 * t.resonance();
    return {t.kp(),       t.kd(),       t.each(t.filter), t.each(t.filter), 0.01 * t.stiffness,
            t.motor_kd(), motor_filter, motor_filter};
  }

  [[nodiscard]] Memory start(const Measurement& measured, const ReferencePoint& reference) const {
    const Vector e1 = measured.q - reference.q_ref;
    const Filter::Memory link = link_filter_.start(e1);
    const auto motor = motor_reference(measured, reference, link_filter_.step(link, e1).nu);
    return {link, motor_filter_.start(measured.theta - robot::value(motor.theta_ref))};
  }

  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measured,
                                  const ReferencePoint& reference) const {
    const Vector e1 = measured.q - reference.q_ref;
    const Filter::Memory link = link_filter_.step(memory.link, e1);
    const auto [torque, theta_ref] = motor_reference(measured, reference, link.nu);
    const Vector e2 = measured.theta - robot::value(theta_ref);
    const Filter::Memory motor = motor_filter_.step(memory.motor, e2);
    const Vector tau = robot_.rotor_inertia.cwiseProduct(robot::second_derivative(theta_ref)) +
                       robot::value(torque) - gains_.kp2.cwiseProduct(e2) -
                       gains_.kd2.cwiseProduct(motor.nu);
    return {{link, motor}, {tau}, {signals.size(), {e1, link.nu, e2, motor.nu}}};
  }

  /// The motors' reference at one instant with its first two time derivatives.
  struct MotorReference {
    robot::JetVector torque;     ///< K (theta_ref - q_ref) [N m]
    robot::JetVector theta_ref;  ///< [rad]
  };

  /// Returns theta_ref (the display after eq. 10) for the link filter's output nu1 [rad/s].
  [[nodiscard]] MotorReference motor_reference(const Measurement& measured,
                                               const ReferencePoint& reference,
                                               const Vector& nu1) const {
    const Vector vdot = robot::forward_dynamics(
        robot_.links, measured.q, measured.v,
        robot_.spring_torque(measured.q, measured.theta));  // eq. 1, first line
    const ReferenceJets r(reference);
    const robot::JetVector q = robot::jet(measured.q, measured.v, vdot);
    const robot::JetVector e1 = q - r.q;
    const Vector nu1dot = link_filter_.derivative(nu1, robot::first_derivative(e1));
    const robot::JetVector nu =
        robot::jet(nu1, nu1dot, link_filter_.derivative(nu1dot, robot::second_derivative(e1)));
    const robot::JetVector torque = robot::inverse_dynamics(robot_.links, q, r.v, r.a) -
                                    e1.cwiseProduct(gains_.kp1) - nu.cwiseProduct(gains_.kd1);
    return {torque, r.q + torque.cwiseQuotient(robot_.stiffness)};
  }

  /// Lyapunov function of eq. 15 with e = (e1, e2), nu = (nu1, nu2), M = blockdiag(M_l, J), Kp =
  /// [Kp1 + K, -K; -K, Kp2 + K], and block diagonal Kd and B. theta_ref and its derivative are
  /// evaluated at the true state.
  static constexpr std::string_view lyapunov_formula =
      "½ ė′Mė + ½ e′Kp e + ½ ν′Kd B⁻¹ν + ε₁ e′Mė − ε₂ ν′Mė, links and motors";
  [[nodiscard]] double lyapunov(const LoopState& state, const ReferencePoint& reference,
                                const LyapunovWeights& weights) const {
    const Vector& nu1 = state.controller.value[1];
    const Vector& nu2 = state.controller.value[3];
    const auto motor = motor_reference({state.q, state.v, state.theta}, reference, nu1);
    const Vector e1 = state.q - reference.q_ref;
    const Vector e2 = state.theta - robot::value(motor.theta_ref);
    const Vector e1dot = state.v - reference.v_ref;
    const Vector e2dot = state.thetadot - robot::first_derivative(motor.theta_ref);
    return equation_15(e1, e1dot, nu1, robot::mass_matrix(robot_.links, state.q) * e1dot,
                       gains_.kp1.cwiseProduct(e1),
                       gains_.kd1.cwiseQuotient(gains_.b1).cwiseProduct(nu1), weights) +
           equation_15(e2, e2dot, nu2, robot_.rotor_inertia.cwiseProduct(e2dot),
                       gains_.kp2.cwiseProduct(e2),
                       gains_.kd2.cwiseQuotient(gains_.b2).cwiseProduct(nu2), weights, e1.size()) +
           0.5 * weighted(robot_.stiffness, e1 - e2);
  }

 private:
  Filter link_filter_ = filter(gains_.a1, gains_.b1);
  Filter motor_filter_ = filter(gains_.a2, gains_.b2);
};

static_assert(Law<LoriaOrtegaFlexible>);
static_assert(std::same_as<LoriaOrtegaFlexible::Measurement, messages::LinkStateMeasurement>);

}  // namespace tachless::controller::law

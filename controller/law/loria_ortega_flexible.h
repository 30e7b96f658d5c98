#pragma once

#include <array>
#include <string_view>
#include <tuple>
#include <utility>

#include "controller/law/feedforward.h"
#include "controller/law/filter.h"
#include "controller/law/flexible_robot.h"
#include "controller/law/law.h"
#include "controller/law/lyapunov.h"
#include "controller/law/settings.h"
#include "controller/law/tuning.h"
#include "robot/forward_dynamics.h"
#include "robot/mass_matrix.h"
#include "schema/schema.h"

namespace tachless::controller::law {

/// Tracking of a robot with flexible joints without link jerk: A. Loria and R. Ortega, "On
/// tracking control of rigid and flexible joint robots", Appl. Math. and Comp. Sci. 5(2), 1995,
/// eq. 9-12,
///
///   theta_ref = q_ref + K^-1 [ ID_l(q, v_ref, vdot_ref) - Kp1 e1 - Kd1 nu1 ],
///   tau = J thetaddot_ref + K (theta_ref - q_ref) - Kp2 e2 - Kd2 nu2,
///   nu_j = diag{ b_j p / (p + a_j) } e_j,   e1 = q - q_ref,   e2 = theta - theta_ref.
///
/// thetaddot_ref is exact: jets (value, first and second time derivative) go through the one
/// inverse dynamics, with q's second derivative from the first line of eq. 1 by forward dynamics;
/// nu1dot = -A1 nu1 + B1 e1dot and nu1ddot = -A1 nu1dot + B1 e1ddot are the continuous filter's
/// equations at the sampled filter's output. The reference's derivatives are used up to snap.
///
/// Measures: link position, link velocity, motor position. Motor velocity and link jerk have no
/// way in. Memory: the two filters.
class LoriaOrtegaFlexible {
 public:
  static constexpr std::string_view name = "loria_ortega_flexible";
  static constexpr std::array signals = {
      loop::Signal{"error_1", "rad"}, loop::Signal{"nu_1", "rad/s"}, loop::Signal{"error_2", "rad"},
      loop::Signal{"nu_2", "rad/s"}};  ///< 1: link, 2: motor
  static constexpr std::string_view source =
      "A. Loria and R. Ortega, On tracking control of rigid and flexible joint robots, Appl. Math. "
      "and Comp. Sci. 5(2), 1995, eq. 9-12 and Prop. 2";
  static constexpr std::string_view proved =
      "exponentially stable, semiglobally in error coordinates, in continuous time";
  static constexpr std::string_view conditions =
      "each b_i > L(D) / (beta_2 l(D)) with D = blockdiag(M_l, J) (12), and the conditions of "
      "loria_ortega_rigid on eps with this D, Kp = [Kp1 + K, -K; -K, Kp2 + K] and block diagonal "
      "Kd, A, B; a reference that is four times continuously differentiable";
  static constexpr bool regulation_only = false;
  static constexpr bool has_feedforward_lead = false;

  using Robot = FlexibleRobot;
  using Measurement = loop::LinkStateMeasurement;
  struct Memory {
    Filter::Memory link;
    Filter::Memory motor;

    static constexpr std::tuple members{&Memory::link, &Memory::motor};
  };

  struct Gains {
    robot::Vector kp1, kd1, a1, b1;  ///< of the link's error
    robot::Vector kp2, kd2, a2, b2;  ///< of the motor's error

    static constexpr std::tuple keys{
        schema::Key{"kp1", &Gains::kp1, "N m/rad", "Weight of the link's position error"}.in(
            schema::positive),
        schema::Key{"kd1", &Gains::kd1, "N m s/rad", "Weight of the link filter's output"}.in(
            schema::positive),
        schema::Key{"a1", &Gains::a1, "1/s", "Link filter's pole"}.in(schema::positive),
        schema::Key{"b1", &Gains::b1, "1/s", "Link filter's gain"}.in(schema::positive),
        schema::Key{"kp2", &Gains::kp2, "N m/rad", "Weight of the motor's position error"}.in(
            schema::positive),
        schema::Key{"kd2", &Gains::kd2, "N m s/rad", "Weight of the motor filter's output"}.in(
            schema::positive),
        schema::Key{"a2", &Gains::a2, "1/s", "Motor filter's pole"}.in(schema::positive),
        schema::Key{"b2", &Gains::b2, "1/s", "Motor filter's gain"}.in(schema::positive)};
  };

  /// The motors' reference at one instant.
  struct MotorReference {
    robot::Vector torque;     ///< K (theta_ref - q_ref) [N m]
    robot::Vector theta_ref;  ///< [rad]
    robot::Vector thetadot_ref;
    robot::Vector thetaddot_ref;
  };

  /// The motor's part damps its resonance, and leaves its stiffness to the spring.
  static Gains tuned(const Tuning& t) {
    const robot::Vector motor_filter = 3 * t.resonance();
    return {t.kp(),       t.kd(),       t.each(t.filter), t.each(t.filter), 0.01 * t.stiffness,
            t.motor_kd(), motor_filter, motor_filter};
  }

  LoriaOrtegaFlexible(Robot robot, Gains gains, const Settings& settings)
      : robot_(std::move(robot)),
        gains_(std::move(gains)),
        link_filter_(gains_.a1, gains_.b1, settings.filter, settings.filter_start,
                     settings.period_s),
        motor_filter_(gains_.a2, gains_.b2, settings.filter, settings.filter_start,
                      settings.period_s) {}

  [[nodiscard]] Memory start(const Measurement& measurement,
                             const loop::ReferencePoint& reference) const {
    const robot::Vector e1 = measurement.q - reference.q_ref;
    const Filter::Memory link = link_filter_.start(e1);
    const MotorReference motor =
        motor_reference(measurement, reference, link_filter_.step(link, e1).nu);
    return {link, motor_filter_.start(measurement.theta - motor.theta_ref)};
  }

  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measurement,
                                  const loop::ReferencePoint& reference, int ticks = 1) const {
    const robot::Vector e1 = measurement.q - reference.q_ref;
    Step<Memory> result;
    result.memory.link = link_filter_.step(memory.link, e1, ticks);
    const MotorReference motor = motor_reference(measurement, reference, result.memory.link.nu);
    const robot::Vector e2 = measurement.theta - motor.theta_ref;
    result.memory.motor = motor_filter_.step(memory.motor, e2, ticks);

    result.command.tau = robot_.rotor_inertia.cwiseProduct(motor.thetaddot_ref) + motor.torque -
                         gains_.kp2.cwiseProduct(e2) -
                         gains_.kd2.cwiseProduct(result.memory.motor.nu);
    result.signals = {signals.size(), {e1, result.memory.link.nu, e2, result.memory.motor.nu}};
    return result;
  }

  /// theta_ref (the display after eq. 10) and its time derivatives, with nu1 [rad/s] the link
  /// filter's output.
  [[nodiscard]] MotorReference motor_reference(const Measurement& measurement,
                                               const loop::ReferencePoint& reference,
                                               const robot::Vector& nu1) const {
    const robot::Vector& q = measurement.q;
    const robot::Vector& v = measurement.v;
    const robot::Vector vdot = robot::forward_dynamics(
        robot_.links, q, v, robot_.spring_torque(q, measurement.theta));  // eq. 1, first line
    const robot::Vector e1 = q - reference.q_ref;
    const robot::Vector e1dot = v - reference.v_ref;
    const robot::Vector e1ddot = vdot - reference.a_ref;
    const robot::Vector nu1dot = link_filter_.derivative(nu1, e1dot);
    const robot::Vector nu1ddot = link_filter_.derivative(nu1dot, e1ddot);

    const robot::JetVector feedforward =
        feedforward_torque(robot_.links, robot::jet(q, v, vdot), reference);

    MotorReference motor;
    motor.torque =
        robot::value(feedforward) - gains_.kp1.cwiseProduct(e1) - gains_.kd1.cwiseProduct(nu1);
    const robot::Vector torque_rate = robot::first_derivative(feedforward) -
                                      gains_.kp1.cwiseProduct(e1dot) -
                                      gains_.kd1.cwiseProduct(nu1dot);
    const robot::Vector torque_second = robot::second_derivative(feedforward) -
                                        gains_.kp1.cwiseProduct(e1ddot) -
                                        gains_.kd1.cwiseProduct(nu1ddot);
    motor.theta_ref = reference.q_ref + motor.torque.cwiseQuotient(robot_.stiffness);
    motor.thetadot_ref = reference.v_ref + torque_rate.cwiseQuotient(robot_.stiffness);
    motor.thetaddot_ref = reference.a_ref + torque_second.cwiseQuotient(robot_.stiffness);
    return motor;
  }

  /// Eq. 15 with e = (e1, e2), nu = (nu1, nu2), M = blockdiag(M_l, J), Kp = [Kp1 + K, -K; -K, Kp2 +
  /// K], Kd and B block diagonal; theta_ref and its derivative at the true state.
  static constexpr std::string_view lyapunov_formula =
      "½ ė′Mė + ½ e′Kp e + ½ ν′Kd B⁻¹ν + ε₁ e′Mė − ε₂ ν′Mė, links and motors";
  [[nodiscard]] double lyapunov(const LoopState& state, const loop::ReferencePoint& reference,
                                const LyapunovWeights& weights) const {
    const robot::Vector& nu1 = state.controller.value[1];
    const robot::Vector& nu2 = state.controller.value[3];
    const MotorReference motor = motor_reference({state.q, state.v, state.theta}, reference, nu1);
    const robot::Vector e1 = state.q - reference.q_ref;
    const robot::Vector e2 = state.theta - motor.theta_ref;
    const robot::Vector e1dot = state.v - reference.v_ref;
    const robot::Vector e2dot = state.thetadot - motor.thetadot_ref;
    return equation_15(e1, e1dot, nu1, robot::mass_matrix(robot_.links, state.q) * e1dot,
                       gains_.kp1, gains_.kd1.cwiseQuotient(gains_.b1), weights) +
           equation_15(e2, e2dot, nu2, robot_.rotor_inertia.cwiseProduct(e2dot), gains_.kp2,
                       gains_.kd2.cwiseQuotient(gains_.b2), weights) +
           0.5 * weighted(robot_.stiffness, e1 - e2);
  }

 private:
  Robot robot_;
  Gains gains_;
  Filter link_filter_;
  Filter motor_filter_;
};

static_assert(Law<LoriaOrtegaFlexible>);
static_assert(std::same_as<LoriaOrtegaFlexible::Measurement, loop::LinkStateMeasurement>);

}  // namespace tachless::controller::law

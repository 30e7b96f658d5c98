#pragma once

#include <array>
#include <string_view>

#include "controller/law/parts.h"
#include "controller/law/rivals/kelly_flexible.h"
#include "robot/dynamics.h"

namespace tachless::controller::law {

/// Tracking of a robot with flexible joints from motor positions alone:
///
///   theta_d = q_ref + K^-1 f,   f = ID_l(q_ref, v_ref, vdot_ref),   em = theta - theta_d,
///   tau = J thetaddot_d + f - Kp em - Kd nu,   nudot = -A nu + B emdot.
///
/// The law does not measure the links and damps them only through the springs. At a constant
/// reference the law is `KellyFlexible`.
class FlexibleMotor : public FlexibleLaw<FilterGains> {
 public:
  static constexpr std::string_view name = "flexible_motor";
  static constexpr std::array signals{Signal{"error", "rad"},
                                      Signal{"nu", "rad/s"}};  ///< the motor's
  static constexpr std::string_view source =
      "derived here from R. Kelly, R. Ortega, A. Ailon and A. Loria, Global regulation of flexible "
      "joint robots using approximate differentiation, IEEE Trans. Automatic Control 39(6), 1994";
  static constexpr std::string_view proved =
      "stable near a slow enough reference, in continuous time; a computed region";
  static constexpr std::string_view conditions =
      "K > k_g and Kp > K k_g / (K - k_g) at every joint, k_g the largest norm of the gradient of "
      "g; a reference that is four times continuously differentiable";

  using Measurement = messages::MotorPositionMeasurement;
  using Memory = Filter::Memory;
  using LawOf::LawOf;

  /// Computes the gains of `KellyFlexible`.
  static Gains tuned(const Tuning& t) { return KellyFlexible::tuned(t); }

  [[nodiscard]] Memory start(const Measurement& measured, const ReferencePoint& reference) const {
    return filter_.start(measured.theta - robot::value(motor_reference(reference).theta_d));
  }

  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measured,
                                  const ReferencePoint& reference) const {
    const auto [torque, theta_d] = motor_reference(reference);
    const Vector e = measured.theta - robot::value(theta_d);
    const Memory next = filter_.step(memory, e);
    const Vector tau = robot_.rotor_inertia.cwiseProduct(robot::second_derivative(theta_d)) +
                       robot::value(torque) - gains_.kp.cwiseProduct(e) -
                       gains_.kd.cwiseProduct(next.nu);
    return {next, {tau}, {signals.size(), {e, next.nu}}};
  }

  /// Torque f and position theta_d with their first two time derivatives.
  struct MotorReference {
    robot::JetVector torque;   ///< [N m]
    robot::JetVector theta_d;  ///< [rad]
  };
  [[nodiscard]] MotorReference motor_reference(const ReferencePoint& reference) const {
    const robot::JetVector torque = feedforward_torque(robot_.links, reference);
    return {torque, ReferenceJets(reference).q + torque.cwiseQuotient(robot_.stiffness)};
  }

 private:
  Filter filter_ = filter(gains_.a, gains_.b);
};

static_assert(OutputFeedbackLaw<FlexibleMotor>);

}  // namespace tachless::controller::law

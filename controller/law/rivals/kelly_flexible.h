#pragma once

#include <array>
#include <string_view>

#include "controller/law/parts.h"
#include "robot/dynamics.h"

namespace tachless::controller::law {

/// Regulation of a robot with flexible joints from motor positions alone, `source`:
///
///   tau = g(q_ref) - Kp (theta - theta_ref) - Kd nu,   theta_ref = q_ref + K^-1 g(q_ref),
///   nudot = -A nu + B thetadot,   q_ref constant.
///
/// The law does not measure the links. The reference is constant by assumption, so a feed-forward
/// lead changes nothing.
class KellyFlexible : public FlexibleLaw<FilterGains> {
 public:
  static constexpr std::string_view name = "kelly_flexible";
  static constexpr std::array signals{Signal{"error", "rad"},
                                      Signal{"nu", "rad/s"}};  ///< the motor's
  static constexpr std::string_view source =
      "R. Kelly, R. Ortega, A. Ailon and A. Loria, Global regulation of flexible joint robots "
      "using approximate differentiation, IEEE Trans. Automatic Control 39(6), 1994";
  static constexpr std::string_view proved = "globally asymptotically stable, in continuous time";
  static constexpr std::string_view conditions =
      "a constant reference; K > k_g and Kp > K k_g / (K - k_g) at every joint, k_g the largest "
      "norm of the gradient of g over all q; any positive Kd, A, B";
  static constexpr bool regulation_only = true;
  static constexpr bool has_feedforward_lead = true;

  using Measurement = messages::MotorPositionMeasurement;
  using Memory = Filter::Memory;
  using LawOf::LawOf;

  /// Computes gains with a filter fast enough to pass the springs' resonance.
  static Gains tuned(const Tuning& t) {
    const auto [kp, kd] = t.through_spring();
    const Vector filter = t.each(t.filter).cwiseMax(0.6 * t.resonance());
    return {kp, kd, filter, filter};
  }

  [[nodiscard]] Memory start(const Measurement& measured, const ReferencePoint& reference) const {
    return filter_.start(error(measured.theta, reference, gravity(reference)));
  }

  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measured,
                                  const ReferencePoint& reference) const {
    const Vector g = gravity(reference);
    const Vector e = error(measured.theta, reference, g);
    const Memory next = filter_.step(memory, e);
    const Vector tau = g - gains_.kp.cwiseProduct(e) - gains_.kd.cwiseProduct(next.nu);
    return {next, {tau}, {signals.size(), {e, next.nu}}};
  }

  /// Lyapunov function with the potential energy U, e1 = q - q_ref and the motor's error e2: 1/2 v'
  /// M_l v + 1/2 thetadot' J thetadot + 1/2 e' [K, -K; -K, K + Kp] e + U(q) - U(q_ref) - g(q_ref)'
  /// e1 + 1/2 nu' Kd B^-1 nu.
  static constexpr std::string_view lyapunov_formula =
      "½ v′M v + ½ θ̇′Jθ̇ + ½ e′[K, −K; −K, K + Kp] e + U(q) − U(q_ref) − g(q_ref)′e₁ + ½ ν′Kd B⁻¹ν";
  [[nodiscard]] double lyapunov(const LoopState& state, const ReferencePoint& reference,
                                const LyapunovWeights& /*weights*/) const {
    const Vector g = gravity(reference);
    const Vector e1 = state.q - reference.q_ref;
    const Vector e2 = error(state.theta, reference, g);
    return 0.5 * state.v.dot(robot::mass_matrix(robot_.links, state.q) * state.v) +
           0.5 * weighted(robot_.rotor_inertia, state.thetadot) +
           0.5 * (weighted(gains_.kp, e2) + weighted(robot_.stiffness, e1 - e2)) +
           robot::potential_energy(robot_.links, state.q) -
           robot::potential_energy(robot_.links, reference.q_ref) - g.dot(e1) +
           0.5 * weighted(gains_.kd.cwiseQuotient(gains_.b), state.controller.value[1]);
  }

 private:
  [[nodiscard]] Vector gravity(const ReferencePoint& reference) const {
    return robot::gravity_torque(robot_.links, reference.q_ref);
  }

  /// Returns theta - theta_ref [rad].
  [[nodiscard]] Vector error(const Vector& theta, const ReferencePoint& reference,
                             const Vector& g) const {
    return theta - (reference.q_ref + g.cwiseQuotient(robot_.stiffness));
  }

  Filter filter_ = filter(gains_.a, gains_.b);
};

static_assert(OutputFeedbackLaw<KellyFlexible>);

}  // namespace tachless::controller::law

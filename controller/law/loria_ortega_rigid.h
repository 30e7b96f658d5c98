#pragma once

#include <array>
#include <string_view>

#include "controller/law/parts.h"
#include "robot/dynamics.h"

/// The law of Loria and Ortega (1995) for rigid joints, and the regulator that it is at a constant
/// reference. The filter that stands in for velocity is in filter.h.
namespace tachless::controller::law {

/// Base of the laws for rigid joints that answer the position error by -Kp e - Kd nu, with nudot =
/// -A nu + B edot, and are proved by eq. 15 of Loria and Ortega (1995); no law by itself.
class FilteredError : public RigidLaw<FilterGains> {
 public:
  static constexpr std::array signals{Signal{"error", "rad"}, Signal{"nu", "rad/s"}};

  using Measurement = loop::PositionMeasurement;
  using Memory = Filter::Memory;
  using LawOf::LawOf;

  static Gains tuned(const Tuning& t) {
    return {t.kp(), t.kd(), t.each(t.filter), t.each(t.filter)};
  }

  [[nodiscard]] Memory start(const Measurement& measured, const ReferencePoint& reference) const {
    return filter_.start(measured.q - reference.q_ref);
  }

  static constexpr std::string_view lyapunov_formula =
      "½ ė′Mė + ½ e′Kp e + ½ ν′Kd B⁻¹ν + ε₁ e′Mė − ε₂ ν′Mė";
  [[nodiscard]] double lyapunov(const LoopState& state, const ReferencePoint& reference,
                                const LyapunovWeights& weights) const {
    const Vector edot = state.v - reference.v_ref;
    return equation_15(state.q - reference.q_ref, edot, state.controller.value[1],
                       robot::mass_matrix(robot_, state.q) * edot, gains_.kp,
                       gains_.kd.cwiseQuotient(gains_.b), weights);
  }

 protected:
  /// The step to tau = feedforward - Kp e - Kd nu.
  [[nodiscard]] Step<Memory> step_from(const Memory& memory, const Vector& e, int ticks,
                                       const Vector& feedforward) const {
    const Memory next = filter_.step(memory, e, ticks);
    const Vector tau = feedforward - gains_.kp.cwiseProduct(e) - gains_.kd.cwiseProduct(next.nu);
    return {next, {tau}, {signals.size(), {e, next.nu}}};
  }

 private:
  Filter filter_ = filter(gains_.a, gains_.b);
};

/// Tracking of a rigid robot from link positions alone, `source`,
///
///   tau = M(q) vdot_ref + C(q, v_ref) v_ref + g(q) - Kp e - Kd nu,   nudot = -A nu + B edot,
///
/// with e = q - q_ref. The first three terms are one inverse dynamics ID(q, v_ref, vdot_ref). With
/// `feedforward_lead_s`, v_ref and vdot_ref of the first two terms are taken that much ahead; q
/// stays the measured one.
class LoriaOrtegaRigid : public FilteredError {
 public:
  static constexpr std::string_view name = "loria_ortega_rigid";
  static constexpr std::string_view source =
      "A. Loria and R. Ortega, On tracking control of rigid and flexible joint robots, Appl. Math. "
      "and Comp. Sci. 5(2), 1995, eq. 4-5 and Prop. 1";
  static constexpr std::string_view proved =
      "semiglobally asymptotically stable, in continuous time";
  static constexpr std::string_view conditions =
      "some eps > 0 lies above k_c B_d / (beta_3 l(B) l(D)) (25) and below 1/2 sqrt(l(Kp) / (2 "
      "L(D))) (19), 1/2 sqrt(l(Kd B^-1) / (2 L(D))) (20), 2 gamma_1 l(Kp) l(Kd B^-1 A) / (L(Kp) + "
      "L(Kd))^2 (23), 2 gamma_1 beta_1 l(Kd B^-1 A) l(B) l(D) / (L(A) L(D))^2 (24) and gamma_2 "
      "l(Kd B^-1 A) / L(Kd) (27); each b_i > L(D) / (beta_2 l(D)) (7); B near a multiple of the "
      "identity; nu(0) bounded as B grows; |x(0)| < c_1 = (beta_2 l(B) l(D) - L(D)) / (2 k_c) "
      "sqrt(alpha_1 / alpha_2) (8). l, L: smallest, largest eigenvalue over all q; D: inertia "
      "matrix; B_d >= sup |v_ref|; beta_1 + beta_2 + beta_3 = 1 and gamma_1 + gamma_2 = 1, free "
      "and > 0";

  using FilteredError::FilteredError;

  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measured,
                                  const ReferencePoint& reference, int ticks = 1) const {
    const auto [v_ref, a_ref] = ahead(reference);
    return step_from(memory, measured.q - reference.q_ref, ticks,
                     robot::inverse_dynamics(robot_, measured.q, v_ref, a_ref));
  }
};

static_assert(OutputFeedbackLaw<LoriaOrtegaRigid>);

/// Regulation of a rigid robot from link positions alone, `source`:
///
///   tau = g(q) - Kp e - Kd nu,   nudot = -A nu + B edot,   q_ref constant.
///
/// `LoriaOrtegaRigid` at a constant reference is this law. The reference is constant by assumption,
/// so a feed-forward lead changes nothing.
class KellyRegulation : public FilteredError {
 public:
  static constexpr std::string_view name = "kelly_regulation";
  static constexpr std::string_view source =
      "R. Kelly, R. Ortega, A. Ailon and A. Loria, Global regulation of flexible joint robots "
      "using approximate differentiation, IEEE Trans. Automatic Control 39(6), 1994, for rigid "
      "joints";
  static constexpr std::string_view proved = "globally asymptotically stable, in continuous time";
  static constexpr std::string_view conditions = "a constant reference; any positive gains";
  static constexpr bool regulation_only = true;

  using FilteredError::FilteredError;

  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measured,
                                  const ReferencePoint& reference, int ticks = 1) const {
    return step_from(memory, measured.q - reference.q_ref, ticks,
                     robot::gravity_torque(robot_, measured.q));
  }
};

static_assert(OutputFeedbackLaw<KellyRegulation>);

}  // namespace tachless::controller::law

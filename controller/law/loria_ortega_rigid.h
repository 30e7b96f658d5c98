#pragma once

#include <string_view>

#include "controller/law/filtered_error.h"

namespace tachless::controller::law {

/// Tracking of a rigid robot from link positions alone (`source`):
///
///   tau = M(q) vdot_ref + C(q, v_ref) v_ref + g(q) - Kp e - Kd nu,   nudot = -A nu + B edot,
///
/// with e = q - q_ref. The first three terms are one inverse dynamics ID(q, v_ref, vdot_ref). With
/// `feedforward_lead_s`, the first two terms use v_ref and vdot_ref at that time ahead; q stays the
/// measured one.
class LoriaOrtegaRigid : public FilteredError<LoriaOrtegaRigid> {
 public:
  static constexpr std::string_view name = "loria_ortega_rigid";
  static constexpr std::string_view source =
      "A. Loria and R. Ortega, On tracking control of rigid and flexible joint robots, Appl. Math. "
      "and Comp. Sci. 5(2), 1995, eq. 4-5 and Prop. 1";
  static constexpr std::string_view proved =
      "semiglobally exponentially stable, in continuous time";
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
};

static_assert(OutputFeedbackLaw<LoriaOrtegaRigid>);

}  // namespace tachless::controller::law

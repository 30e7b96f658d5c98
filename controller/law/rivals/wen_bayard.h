#pragma once

#include <array>
#include <string_view>

#include "controller/law/parts.h"
#include "robot/dynamics.h"

namespace tachless::controller::law {

/// Tracking of a rigid robot with measured velocity (`source`):
///
///   tau = M(q) vdot_ref + C(q, v_ref) v_ref + g(q) - Kp e - Kd edot.
///
/// It is `LoriaOrtegaRigid` with measured velocity (the paper's Remark 2). With
/// `feedforward_lead_s`, the first two terms use v_ref and vdot_ref at that time ahead; e and edot
/// are not taken ahead.
class WenBayard : public RigidLaw<PdGains>, public FullState {
 public:
  static constexpr std::string_view name = "wen_bayard";
  static constexpr std::array signals{Signal{"error", "rad"}, Signal{"edot", "rad/s"}};
  static constexpr std::string_view source =
      "J. T. Wen and D. S. Bayard, New class of control laws for robotic manipulators, Int. J. of "
      "Control 47(5), 1988, eq. 4.2";
  static constexpr std::string_view proved = "globally asymptotically stable, in continuous time";
  static constexpr std::string_view conditions =
      "lambda_min(Kd) > k_c sup |v_ref|, with |C(q, x) y| <= k_c |x| |y|; any positive Kp";

  using LawOf::LawOf;

  static Gains tuned(const Tuning& t) { return {t.kp(), t.kd()}; }

  [[nodiscard]] Step<Memory> step(const Memory& /*memory*/, const Measurement& measured,
                                  const ReferencePoint& reference) const {
    const Vector e = measured.q - reference.q_ref;
    const Vector edot = measured.v - reference.v_ref;
    const auto [v_ref, a_ref] = ahead(reference);
    const Vector tau = robot::inverse_dynamics(robot_, measured.q, v_ref, a_ref) -
                       gains_.kp.cwiseProduct(e) - gains_.kd.cwiseProduct(edot);
    return {{}, {tau}, {signals.size(), {e, edot}}};
  }

  static constexpr std::string_view lyapunov_formula = "½ ė′Mė + ½ e′Kp e";
  [[nodiscard]] double lyapunov(const LoopState& state, const ReferencePoint& reference,
                                const LyapunovWeights& /*weights*/) const {
    const Vector edot = state.v - reference.v_ref;
    return 0.5 * edot.dot(robot::mass_matrix(robot_, state.q) * edot) +
           0.5 * weighted(gains_.kp, state.q - reference.q_ref);
  }
};

static_assert(Law<WenBayard>);
static_assert(!OutputFeedbackLaw<WenBayard>);

}  // namespace tachless::controller::law

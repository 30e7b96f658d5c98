#pragma once

#include <array>
#include <string_view>
#include <tuple>

#include "controller/law/parts.h"
#include "robot/dynamics.h"

namespace tachless::controller::law {

struct SlotineLiGains {
  Vector lambda, ks;

  static constexpr std::tuple keys{gain("lambda", &SlotineLiGains::lambda, "1/s",
                                        "Weight of the position error in s = edot + lambda e"),
                                   gain("ks", &SlotineLiGains::ks, "N m s/rad", "Weight of s")};
};

/// Tracking of a rigid robot with measured velocity and known parameters, `source`:
///
///   v_r = v_ref - Lambda e,   s = v - v_r,   tau = M(q) v_rdot + C(q, v) v_r + g(q) - Ks s.
///
/// With `feedforward_lead_s`, the first two terms use v_ref and vdot_ref at that time ahead; e, s
/// and edot are not taken ahead.
class SlotineLi : public RigidLaw<SlotineLiGains>, public FullState {
 public:
  static constexpr std::string_view name = "slotine_li";
  static constexpr std::array signals{Signal{"error", "rad"}, Signal{"edot", "rad/s"}};
  static constexpr std::string_view source =
      "J.-J. E. Slotine and W. Li, Adaptive manipulator control: a case study, IEEE Trans. "
      "Automatic Control 33(11), 1988, without its adaptation";
  static constexpr std::string_view proved = "globally exponentially stable, in continuous time";
  static constexpr std::string_view conditions = "any positive gains";

  using LawOf::LawOf;

  static Gains tuned(const Tuning& t) {
    return {t.each(t.w / t.damping), t.damping * t.w * t.inertia};
  }

  [[nodiscard]] Step<Memory> step(const Memory& /*memory*/, const Measurement& measured,
                                  const ReferencePoint& reference) const {
    const Vector e = measured.q - reference.q_ref;
    const Vector edot = measured.v - reference.v_ref;
    const Vector s = edot + gains_.lambda.cwiseProduct(e);
    const auto [v_ref, a_ref] = ahead(reference);
    const Vector v_r = v_ref - gains_.lambda.cwiseProduct(e);
    const Vector a_r = a_ref - gains_.lambda.cwiseProduct(edot);
    const Vector tau = robot::inverse_dynamics_bilinear(robot_, measured.q, measured.v, v_r, a_r) -
                       gains_.ks.cwiseProduct(s);
    return {{}, {tau}, {signals.size(), {e, edot}}};
  }

  /// Lyapunov function V with Vdot = -edot' Ks edot - e' Lambda Ks Lambda e.
  static constexpr std::string_view lyapunov_formula = "½ s′M s + e′Λ Ks e,  s = ė + Λ e";
  [[nodiscard]] double lyapunov(const LoopState& state, const ReferencePoint& reference,
                                const LyapunovWeights& /*weights*/) const {
    const Vector e = state.q - reference.q_ref;
    const Vector s = state.v - reference.v_ref + gains_.lambda.cwiseProduct(e);
    return 0.5 * s.dot(robot::mass_matrix(robot_, state.q) * s) +
           weighted(gains_.lambda.cwiseProduct(gains_.ks), e);
  }
};

static_assert(Law<SlotineLi>);
static_assert(!OutputFeedbackLaw<SlotineLi>);

}  // namespace tachless::controller::law

#pragma once

#include <array>
#include <string_view>
#include <tuple>

#include "controller/law/parts.h"
#include "robot/dynamics.h"

/// The known laws for rigid joints that measure velocity: what the laws without it are compared
/// with.
namespace tachless::controller::law {

struct ComputedTorqueGains {
  Vector kp, kd;

  static constexpr std::tuple keys{
      gain("kp", &ComputedTorqueGains::kp, "1/s^2", "Acceleration per position error"),
      gain("kd", &ComputedTorqueGains::kd, "1/s", "Acceleration per velocity error")};
};

/// Tracking of a rigid robot by inverse dynamics of the measured state, the common baseline:
///
///   tau = M(q) (vdot_ref - Kd edot - Kp e) + C(q, v) v + g(q).
///
/// With `feedforward_lead_s`, vdot_ref is taken that much ahead; everything else is of the measured
/// state.
class ComputedTorque : public RigidLaw<ComputedTorqueGains>, public FullState {
 public:
  static constexpr std::string_view name = "computed_torque";
  static constexpr std::array signals{Signal{"error", "rad"}, Signal{"edot", "rad/s"}};
  static constexpr std::string_view source =
      "B. R. Markiewicz, Analysis of the computed torque drive method and comparison with "
      "conventional position servo for a computer-controlled manipulator, Jet Propulsion "
      "Laboratory, Technical Memorandum 33-601, 1973; today a textbook's law";
  static constexpr std::string_view proved = "globally exponentially stable, in continuous time";
  static constexpr std::string_view conditions = "any positive gains; an exact model";

  using LawOf::LawOf;

  static Gains tuned(const Tuning& t) { return {t.each(t.w * t.w), t.each(2 * t.damping * t.w)}; }

  [[nodiscard]] Step<Memory> step(const Memory& /*memory*/, const Measurement& measured,
                                  const ReferencePoint& reference, int /*ticks*/ = 1) const {
    const Vector e = measured.q - reference.q_ref;
    const Vector edot = measured.v - reference.v_ref;
    const Vector wanted =
        ahead(reference).a_ref - gains_.kd.cwiseProduct(edot) - gains_.kp.cwiseProduct(e);
    return {{},
            {robot::inverse_dynamics(robot_, measured.q, measured.v, wanted)},
            {signals.size(), {e, edot}}};
  }
};

static_assert(Law<ComputedTorque>);
static_assert(!OutputFeedbackLaw<ComputedTorque>);

struct PdGravityGains {
  Vector kp, kd;

  static constexpr std::tuple keys{
      gain("kp", &PdGravityGains::kp, "N m/rad", "Weight of the position error"),
      gain("kd", &PdGravityGains::kd, "N m s/rad", "Weight of the velocity")};
};

/// Regulation of a rigid robot with measured velocity, `source`,
///
///   tau = g(q) - Kp e - Kd v,   q_ref constant.
///
/// What `KellyRegulation` would be with a tachometer. A feed-forward lead changes nothing.
class PdGravity : public RigidLaw<PdGravityGains>, public FullState {
 public:
  static constexpr std::string_view name = "pd_gravity";
  static constexpr std::array signals{Signal{"error", "rad"}};
  static constexpr std::string_view source =
      "M. Takegaki and S. Arimoto, A new feedback method for dynamic control of manipulators, ASME "
      "J. of Dynamic Systems, Measurement, and Control 103(2), 1981";
  static constexpr std::string_view proved = "globally asymptotically stable, in continuous time";
  static constexpr std::string_view conditions = "a constant reference; any positive gains";
  static constexpr bool regulation_only = true;

  using LawOf::LawOf;

  static Gains tuned(const Tuning& t) { return {t.kp(), t.kd()}; }

  [[nodiscard]] Step<Memory> step(const Memory& /*memory*/, const Measurement& measured,
                                  const ReferencePoint& reference, int /*ticks*/ = 1) const {
    const Vector e = measured.q - reference.q_ref;
    const Vector tau = robot::gravity_torque(robot_, measured.q) - gains_.kp.cwiseProduct(e) -
                       gains_.kd.cwiseProduct(measured.v);
    return {{}, {tau}, {signals.size(), {e}}};
  }

  /// Vdot = -v' Kd v.
  static constexpr std::string_view lyapunov_formula = "½ v′M v + ½ e′Kp e";
  [[nodiscard]] double lyapunov(const LoopState& state, const ReferencePoint& reference,
                                const LyapunovWeights& /*weights*/) const {
    return robot::kinetic_energy(robot_, state.q, state.v) +
           0.5 * weighted(gains_.kp, state.q - reference.q_ref);
  }
};

static_assert(Law<PdGravity>);
static_assert(!OutputFeedbackLaw<PdGravity>);

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
/// With `feedforward_lead_s`, v_ref and vdot_ref in the first two terms are taken that much ahead;
/// e, s and edot are not.
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
                                  const ReferencePoint& reference, int /*ticks*/ = 1) const {
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

  /// Vdot = -edot' Ks edot - e' Lambda Ks Lambda e.
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

struct WenBayardGains {
  Vector kp, kd;

  static constexpr std::tuple keys{
      gain("kp", &WenBayardGains::kp, "N m/rad", "Weight of the position error"),
      gain("kd", &WenBayardGains::kd, "N m s/rad", "Weight of the velocity error")};
};

/// Tracking of a rigid robot with measured velocity, `source`,
///
///   tau = M(q) vdot_ref + C(q, v_ref) v_ref + g(q) - Kp e - Kd edot.
///
/// What `LoriaOrtegaRigid` would be with a tachometer (the paper's Remark 2). With
/// `feedforward_lead_s`, v_ref and vdot_ref of the first two terms are taken that much ahead; e and
/// edot are not.
class WenBayard : public RigidLaw<WenBayardGains>, public FullState {
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
                                  const ReferencePoint& reference, int /*ticks*/ = 1) const {
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

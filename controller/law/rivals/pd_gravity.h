#pragma once

#include <array>
#include <string_view>

#include "controller/law/parts.h"
#include "robot/dynamics.h"

namespace tachless::controller::law {

/// Regulation of a rigid robot with measured velocity (`source`):
///
///   tau = g(q) - Kp e - Kd v,   q_ref constant.
///
/// It is `KellyRegulation` with measured velocity. A feed-forward lead changes nothing.
class PdGravity : public RigidLaw<PdGains>, public FullState {
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
                                  const ReferencePoint& reference) const {
    const Vector e = measured.q - reference.q_ref;
    const Vector tau = robot::gravity_torque(robot_, measured.q) - gains_.kp.cwiseProduct(e) -
                       gains_.kd.cwiseProduct(measured.v);
    return {{}, {tau}, {signals.size(), {e}}};
  }

  /// Lyapunov function V with Vdot = -v' Kd v.
  static constexpr std::string_view lyapunov_formula = "½ v′M v + ½ e′Kp e";
  [[nodiscard]] double lyapunov(const LoopState& state, const ReferencePoint& reference,
                                const LyapunovWeights& /*weights*/) const {
    return 0.5 * state.v.dot(robot::mass_matrix(robot_, state.q) * state.v) +
           0.5 * weighted(gains_.kp, state.q - reference.q_ref);
  }
};

static_assert(Law<PdGravity>);
static_assert(!OutputFeedbackLaw<PdGravity>);

}  // namespace tachless::controller::law

#pragma once

#include <array>
#include <string_view>
#include <tuple>

#include "controller/law/parts.h"

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
/// With `feedforward_lead_s`, vdot_ref is evaluated at that time ahead; all other values belong to
/// the measured instant.
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
                                  const ReferencePoint& reference) const {
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

}  // namespace tachless::controller::law

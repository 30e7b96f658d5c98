#pragma once

#include <array>
#include <string_view>
#include <tuple>
#include <utility>

#include "controller/law/feedforward.h"
#include "controller/law/full_state.h"
#include "controller/law/law.h"
#include "controller/law/settings.h"
#include "controller/law/tuning.h"
#include "robot/inverse_dynamics.h"
#include "robot/model.h"
#include "schema/schema.h"

namespace tachless::controller::law {

/// Tracking of a rigid robot by inverse dynamics of the measured state, the common baseline:
///
///   tau = M(q) (vdot_ref - Kd edot - Kp e) + C(q, v) v + g(q).
///
/// Measures: the full state. Memory: none. With `feedforward_lead_s`, vdot_ref is taken that much
/// ahead; everything else is of the measured state.
class ComputedTorque : public FullState {
 public:
  static constexpr std::string_view name = "computed_torque";
  static constexpr std::array signals = {loop::Signal{"error", "rad"},
                                         loop::Signal{"edot", "rad/s"}};
  static constexpr std::string_view source =
      "B. R. Markiewicz, Analysis of the computed torque drive method and comparison with "
      "conventional position servo for a computer-controlled manipulator, Jet Propulsion "
      "Laboratory, Technical Memorandum 33-601, 1973; today a textbook's law";
  static constexpr std::string_view proved = "globally exponentially stable, in continuous time";
  static constexpr std::string_view conditions = "any positive gains; an exact model";
  static constexpr bool regulation_only = false;
  static constexpr bool has_feedforward_lead = true;

  using Robot = robot::Model;  ///< rotor inertia included: M = M_l + J

  struct Gains {
    robot::Vector kp, kd;

    static constexpr std::tuple keys{
        schema::Key{"kp", &Gains::kp, "1/s^2", "Acceleration per position error"}.in(
            schema::positive),
        schema::Key{"kd", &Gains::kd, "1/s", "Acceleration per velocity error"}.in(
            schema::positive)};
  };

  static Gains tuned(const Tuning& t) { return {t.each(t.w * t.w), t.each(2 * t.damping * t.w)}; }

  ComputedTorque(Robot model, Gains gains, const Settings& settings)
      : model_(std::move(model)), gains_(std::move(gains)), lead_s_(settings.feedforward_lead_s) {}

  [[nodiscard]] Step<Memory> step(const Memory& /*memory*/, const Measurement& measurement,
                                  const loop::ReferencePoint& reference, int /*ticks*/ = 1) const {
    const robot::Vector e = measurement.q - reference.q_ref;
    const robot::Vector edot = measurement.v - reference.v_ref;
    const robot::Vector wanted = feedforward_ahead(reference, lead_s_).a_ref -
                                 gains_.kd.cwiseProduct(edot) - gains_.kp.cwiseProduct(e);
    Step<Memory> result;
    result.command.tau = robot::inverse_dynamics(model_, measurement.q, measurement.v, wanted);
    result.signals = {signals.size(), {e, edot}};
    return result;
  }

 private:
  robot::Model model_;
  Gains gains_;
  double lead_s_;
};

static_assert(Law<ComputedTorque>);
static_assert(!OutputFeedbackLaw<ComputedTorque>);

}  // namespace tachless::controller::law

#pragma once

#include <array>
#include <string_view>
#include <tuple>
#include <utility>

#include "controller/law/feedforward.h"
#include "controller/law/full_state.h"
#include "controller/law/law.h"
#include "controller/law/lyapunov.h"
#include "controller/law/settings.h"
#include "controller/law/tuning.h"
#include "robot/inverse_dynamics.h"
#include "robot/mass_matrix.h"
#include "robot/model.h"
#include "schema/schema.h"

namespace tachless::controller::law {

/// Tracking of a rigid robot with measured velocity and known parameters: J.-J. E. Slotine and
/// W. Li, "Adaptive manipulator control: a case study", IEEE Trans. Automatic Control 33(11), 1988,
/// without its adaptation:
///
///   v_r = v_ref - Lambda e,   s = v - v_r,   tau = M(q) v_rdot + C(q, v) v_r + g(q) - Ks s.
///
/// Measures: the full state. Memory: none. With
/// `feedforward_lead_s`, v_ref and vdot_ref in the first two terms are taken that much ahead; e, s
/// and edot are not.
class SlotineLi : public FullState {
 public:
  static constexpr std::string_view name = "slotine_li";
  static constexpr std::array signals = {loop::Signal{"error", "rad"},
                                         loop::Signal{"edot", "rad/s"}};
  static constexpr std::string_view source =
      "J.-J. E. Slotine and W. Li, Adaptive manipulator control: a case study, IEEE Trans. "
      "Automatic Control 33(11), 1988, without its adaptation";
  static constexpr std::string_view proved = "globally exponentially stable, in continuous time";
  static constexpr std::string_view conditions = "any positive gains";
  static constexpr bool regulation_only = false;
  static constexpr bool has_feedforward_lead = true;

  using Robot = robot::Model;  ///< rotor inertia included: M = M_l + J

  struct Gains {
    robot::Vector lambda, ks;

    static constexpr std::tuple keys{
        schema::Key{"lambda", &Gains::lambda, "1/s",
                    "Weight of the position error in s = edot + lambda e"}
            .in(schema::positive),
        schema::Key{"ks", &Gains::ks, "N m s/rad", "Weight of s"}.in(schema::positive)};
  };

  static Gains tuned(const Tuning& t) {
    return {t.each(t.w / t.damping), t.damping * t.w * t.inertia};
  }

  SlotineLi(Robot model, Gains gains, const Settings& settings)
      : model_(std::move(model)), gains_(std::move(gains)), lead_s_(settings.feedforward_lead_s) {}

  [[nodiscard]] Step<Memory> step(const Memory& /*memory*/, const Measurement& measurement,
                                  const loop::ReferencePoint& reference, int /*ticks*/ = 1) const {
    const robot::Vector e = measurement.q - reference.q_ref;
    const robot::Vector edot = measurement.v - reference.v_ref;
    const robot::Vector s = edot + gains_.lambda.cwiseProduct(e);
    const Feedforward ahead = feedforward_ahead(reference, lead_s_);
    const robot::Vector v_r = ahead.v_ref - gains_.lambda.cwiseProduct(e);
    const robot::Vector a_r = ahead.a_ref - gains_.lambda.cwiseProduct(edot);
    Step<Memory> result;
    result.command.tau =
        robot::inverse_dynamics_bilinear(model_, measurement.q, measurement.v, v_r, a_r) -
        gains_.ks.cwiseProduct(s);
    result.signals = {signals.size(), {e, edot}};
    return result;
  }

  /// Vdot = -edot' Ks edot - e' Lambda Ks Lambda e.
  static constexpr std::string_view lyapunov_formula = "½ s′M s + e′Λ Ks e,  s = ė + Λ e";
  [[nodiscard]] double lyapunov(const LoopState& state, const loop::ReferencePoint& reference,
                                const LyapunovWeights& /*weights*/) const {
    const robot::Vector e = state.q - reference.q_ref;
    const robot::Vector s = state.v - reference.v_ref + gains_.lambda.cwiseProduct(e);
    return 0.5 * s.dot(robot::mass_matrix(model_, state.q) * s) +
           weighted(gains_.lambda.cwiseProduct(gains_.ks), e);
  }

 private:
  robot::Model model_;
  Gains gains_;
  double lead_s_;
};

static_assert(Law<SlotineLi>);
static_assert(!OutputFeedbackLaw<SlotineLi>);

}  // namespace tachless::controller::law

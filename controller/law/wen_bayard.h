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

/// Tracking of a rigid robot with measured velocity: J. T. Wen and D. S. Bayard, "New class of
/// control laws for robotic manipulators", Int. J. of Control 47(5), 1988, eq. 4.2,
///
///   tau = M(q) vdot_ref + C(q, v_ref) v_ref + g(q) - Kp e - Kd edot.
///
/// What `LoriaOrtegaRigid` would be with a tachometer (the paper's Remark 2).
///
/// Measures: the full state. Memory: none.
/// With `feedforward_lead_s`, v_ref and vdot_ref of the first two terms are taken that much ahead;
/// e and edot are not.
class WenBayard : public FullState {
 public:
  static constexpr std::string_view name = "wen_bayard";
  static constexpr std::array signals = {loop::Signal{"error", "rad"},
                                         loop::Signal{"edot", "rad/s"}};
  static constexpr std::string_view source =
      "J. T. Wen and D. S. Bayard, New class of control laws for robotic manipulators, Int. J. of "
      "Control 47(5), 1988, eq. 4.2";
  static constexpr std::string_view proved = "globally asymptotically stable, in continuous time";
  static constexpr std::string_view conditions =
      "lambda_min(Kd) > k_c sup |v_ref|, with |C(q, x) y| <= k_c |x| |y|; any positive Kp";
  static constexpr bool regulation_only = false;
  static constexpr bool has_feedforward_lead = true;

  using Robot = robot::Model;  ///< rotor inertia included: M = M_l + J

  struct Gains {
    robot::Vector kp, kd;

    static constexpr std::tuple keys{
        schema::Key{"kp", &Gains::kp, "N m/rad", "Weight of the position error"}.in(
            schema::positive),
        schema::Key{"kd", &Gains::kd, "N m s/rad", "Weight of the velocity error"}.in(
            schema::positive)};
  };

  static Gains tuned(const Tuning& t) { return {t.kp(), t.kd()}; }

  WenBayard(Robot model, Gains gains, const Settings& settings)
      : model_(std::move(model)), gains_(std::move(gains)), lead_s_(settings.feedforward_lead_s) {}

  [[nodiscard]] Step<Memory> step(const Memory& /*memory*/, const Measurement& measurement,
                                  const loop::ReferencePoint& reference, int /*ticks*/ = 1) const {
    const robot::Vector e = measurement.q - reference.q_ref;
    const robot::Vector edot = measurement.v - reference.v_ref;
    const Feedforward ahead = feedforward_ahead(reference, lead_s_);
    Step<Memory> result;
    result.command.tau = robot::inverse_dynamics(model_, measurement.q, ahead.v_ref, ahead.a_ref) -
                         gains_.kp.cwiseProduct(e) - gains_.kd.cwiseProduct(edot);
    result.signals = {signals.size(), {e, edot}};
    return result;
  }

  static constexpr std::string_view lyapunov_formula = "½ ė′Mė + ½ e′Kp e";
  [[nodiscard]] double lyapunov(const LoopState& state, const loop::ReferencePoint& reference,
                                const LyapunovWeights& /*weights*/) const {
    const robot::Vector edot = state.v - reference.v_ref;
    return 0.5 * edot.dot(robot::mass_matrix(model_, state.q) * edot) +
           0.5 * weighted(gains_.kp, state.q - reference.q_ref);
  }

 private:
  robot::Model model_;
  Gains gains_;
  double lead_s_;
};

static_assert(Law<WenBayard>);
static_assert(!OutputFeedbackLaw<WenBayard>);

}  // namespace tachless::controller::law

#pragma once

#include <array>
#include <string_view>
#include <tuple>
#include <utility>

#include "controller/law/full_state.h"
#include "controller/law/law.h"
#include "controller/law/lyapunov.h"
#include "controller/law/settings.h"
#include "controller/law/tuning.h"
#include "robot/energy.h"
#include "robot/inverse_dynamics.h"
#include "robot/model.h"
#include "schema/schema.h"

namespace tachless::controller::law {

/// Regulation of a rigid robot with measured velocity: M. Takegaki and S. Arimoto, "A new feedback
/// method for dynamic control of manipulators", ASME J. of Dynamic Systems, Measurement, and
/// Control 103(2), 1981,
///
///   tau = g(q) - Kp e - Kd v,   q_ref constant.
///
/// What `KellyRegulation` would be with a tachometer.
///
/// Measures: the full state. Memory: none. A feed-forward lead changes nothing.
class PdGravity : public FullState {
 public:
  static constexpr std::string_view name = "pd_gravity";
  static constexpr std::array signals = {loop::Signal{"error", "rad"}};
  static constexpr std::string_view source =
      "M. Takegaki and S. Arimoto, A new feedback method for dynamic control of manipulators, ASME "
      "J. of Dynamic Systems, Measurement, and Control 103(2), 1981";
  static constexpr std::string_view proved = "globally asymptotically stable, in continuous time";
  static constexpr std::string_view conditions = "a constant reference; any positive gains";
  static constexpr bool regulation_only = true;
  static constexpr bool has_feedforward_lead = true;

  using Robot = robot::Model;  ///< rotor inertia included: M = M_l + J

  struct Gains {
    robot::Vector kp, kd;

    static constexpr std::tuple keys{
        schema::Key{"kp", &Gains::kp, "N m/rad", "Weight of the position error"}.in(
            schema::positive),
        schema::Key{"kd", &Gains::kd, "N m s/rad", "Weight of the velocity"}.in(schema::positive)};
  };

  static Gains tuned(const Tuning& t) { return {t.kp(), t.kd()}; }

  PdGravity(Robot model, Gains gains, const Settings& /*settings*/)
      : model_(std::move(model)), gains_(std::move(gains)) {}

  [[nodiscard]] Step<Memory> step(const Memory& /*memory*/, const Measurement& measurement,
                                  const loop::ReferencePoint& reference, int /*ticks*/ = 1) const {
    const robot::Vector e = measurement.q - reference.q_ref;
    Step<Memory> result;
    result.command.tau = robot::gravity_torque(model_, measurement.q) - gains_.kp.cwiseProduct(e) -
                         gains_.kd.cwiseProduct(measurement.v);
    result.signals = {signals.size(), {e}};
    return result;
  }

  /// Vdot = -v' Kd v.
  static constexpr std::string_view lyapunov_formula = "½ v′M v + ½ e′Kp e";
  [[nodiscard]] double lyapunov(const LoopState& state, const loop::ReferencePoint& reference,
                                const LyapunovWeights& /*weights*/) const {
    return robot::kinetic_energy(model_, state.q, state.v) +
           0.5 * weighted(gains_.kp, state.q - reference.q_ref);
  }

 private:
  robot::Model model_;
  Gains gains_;
};

static_assert(Law<PdGravity>);
static_assert(!OutputFeedbackLaw<PdGravity>);

}  // namespace tachless::controller::law

#pragma once

#include <array>
#include <string_view>
#include <utility>

#include "controller/law/feedforward.h"
#include "controller/law/filter.h"
#include "controller/law/law.h"
#include "controller/law/settings.h"
#include "robot/inverse_dynamics.h"
#include "robot/model.h"

namespace tachless::controller::law {

/// Tracking of a rigid robot from link positions alone: A. Loria and R. Ortega, "On tracking
/// control of rigid and flexible joint robots", Appl. Math. and Comp. Sci. 5(2), 1995, eq. 4-5,
///
///   tau = M(q) vdot_ref + C(q, v_ref) v_ref + g(q) - Kp e - Kd nu,   nudot = -A nu + B edot,
///
/// with e = q - q_ref. The first three terms are one inverse dynamics ID(q, v_ref, vdot_ref).
///
/// Measures: link position. Memory: the filter. Conditions: eq. 7 and gains large enough
/// (docs/laws). With `feedforward_lead_s`, v_ref and vdot_ref of the first two
/// terms are taken that much ahead; q stays the measured one.
class LoriaOrtegaRigid {
 public:
  static constexpr std::string_view name = "loria_ortega_rigid";
  static constexpr std::array signals = {loop::Signal{"error", "rad"}, loop::Signal{"nu", "rad/s"}};
  static constexpr bool regulation_only = false;
  static constexpr bool has_feedforward_lead = true;

  using Robot = robot::Model;  ///< rotor inertia included: M = M_l + J
  using Measurement = loop::PositionMeasurement;
  using Memory = Filter::Memory;

  struct Gains {
    robot::Vector kp;  ///< [N m/rad]
    robot::Vector kd;  ///< [N m s/rad]
    robot::Vector a;   ///< filter pole [1/s]
    robot::Vector b;   ///< filter gain [1/s]

    static constexpr std::array<GainName<Gains>, 4> names{
        {{"kp", &Gains::kp}, {"kd", &Gains::kd}, {"a", &Gains::a}, {"b", &Gains::b}}};
  };

  LoriaOrtegaRigid(Robot model, Gains gains, const Settings& settings)
      : model_(std::move(model)),
        gains_(std::move(gains)),
        filter_(gains_.a, gains_.b, settings.filter, settings.filter_start, settings.period_s),
        lead_s_(settings.feedforward_lead_s) {}

  [[nodiscard]] Memory start(const Measurement& measurement,
                             const loop::ReferencePoint& reference) const {
    return filter_.start(measurement.q - reference.q_ref);
  }

  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measurement,
                                  const loop::ReferencePoint& reference, int ticks = 1) const {
    const robot::Vector e = measurement.q - reference.q_ref;
    Step<Memory> result{filter_.step(memory, e, ticks), {}, {}};
    const robot::Vector& nu = result.memory.nu;
    const Feedforward ahead = feedforward_ahead(reference, lead_s_);
    result.command.tau = robot::inverse_dynamics(model_, measurement.q, ahead.v_ref, ahead.a_ref) -
                         gains_.kp.cwiseProduct(e) - gains_.kd.cwiseProduct(nu);
    result.signals = {signals.size(), {e, nu}};
    return result;
  }

 private:
  robot::Model model_;
  Gains gains_;
  Filter filter_;
  double lead_s_;
};

static_assert(OutputFeedbackLaw<LoriaOrtegaRigid>);

}  // namespace tachless::controller::law

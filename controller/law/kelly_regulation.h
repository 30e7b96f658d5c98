#pragma once

#include <array>
#include <string_view>
#include <utility>

#include "controller/law/equation_15.h"
#include "controller/law/filter.h"
#include "controller/law/law.h"
#include "controller/law/settings.h"
#include "robot/inverse_dynamics.h"

namespace tachless::controller::law {

/// Regulation of a rigid robot from link positions alone: R. Kelly, R. Ortega, A. Ailon and
/// A. Loria, "Global regulation of flexible joint robots using approximate differentiation", IEEE
/// Trans. Automatic Control 39(6), 1994, in its rigid form:
///
///   tau = g(q) - Kp e - Kd nu,   nudot = -A nu + B edot,   q_ref constant.
///
/// `LoriaOrtegaRigid` at a constant reference is this law.
///
/// Measures: link position. Memory: the filter. The reference is constant by assumption, so a
/// feed-forward lead changes nothing.
class KellyRegulation : public Equation15 {
 public:
  static constexpr std::string_view name = "kelly_regulation";
  static constexpr std::array signals = {loop::Signal{"error", "rad"}, loop::Signal{"nu", "rad/s"}};
  static constexpr std::string_view source =
      "R. Kelly, R. Ortega, A. Ailon and A. Loria, Global regulation of flexible joint robots "
      "using approximate differentiation, IEEE Trans. Automatic Control 39(6), 1994, for rigid "
      "joints";
  static constexpr std::string_view proved = "globally asymptotically stable, in continuous time";
  static constexpr std::string_view conditions = "a constant reference; any positive gains";
  static constexpr bool regulation_only = true;
  static constexpr bool has_feedforward_lead = true;

  using Measurement = loop::PositionMeasurement;
  using Memory = Filter::Memory;

  KellyRegulation(Robot model, Gains gains, const Settings& settings)
      : Equation15(std::move(model), std::move(gains)),
        filter_(gains_.a, gains_.b, settings.filter, settings.filter_start, settings.period_s) {}

  [[nodiscard]] Memory start(const Measurement& measurement,
                             const loop::ReferencePoint& reference) const {
    return filter_.start(measurement.q - reference.q_ref);
  }

  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measurement,
                                  const loop::ReferencePoint& reference, int ticks = 1) const {
    const robot::Vector e = measurement.q - reference.q_ref;
    Step<Memory> result{filter_.step(memory, e, ticks), {}, {}};
    const robot::Vector& nu = result.memory.nu;
    result.command.tau = robot::gravity_torque(model_, measurement.q) - gains_.kp.cwiseProduct(e) -
                         gains_.kd.cwiseProduct(nu);
    result.signals = {signals.size(), {e, nu}};
    return result;
  }

 private:
  Filter filter_;
};

static_assert(OutputFeedbackLaw<KellyRegulation>);

}  // namespace tachless::controller::law

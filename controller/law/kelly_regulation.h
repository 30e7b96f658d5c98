#pragma once

#include <array>
#include <string_view>
#include <utility>

#include "controller/law/filter.h"
#include "controller/law/law.h"
#include "controller/law/settings.h"
#include "robot/inverse_dynamics.h"
#include "robot/model.h"

namespace tachless::controller::law {

/// Regulation of a rigid robot from link positions alone: R. Kelly, R. Ortega, A. Ailon and
/// A. Loria, "Global regulation of flexible joint robots using approximate differentiation", IEEE
/// Trans. Automatic Control 39(6), 1994, in its rigid form:
///
///   tau = g(q) - Kp e - Kd nu,   nudot = -A nu + B edot,   q_ref constant.
///
/// `LoriaOrtegaRigid` at a constant reference is this law.
///
/// Measures: link position. Memory: the filter. Conditions: a constant reference; then any
/// positive gains, globally. It is constant by assumption, so a feed-forward lead changes nothing.
class KellyRegulation {
 public:
  static constexpr std::string_view name = "kelly_regulation";
  static constexpr std::array signals = {loop::Signal{"error", "rad"}, loop::Signal{"nu", "rad/s"}};
  static constexpr bool regulation_only = true;
  static constexpr bool has_feedforward_lead = true;

  using Robot = robot::Model;
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

  KellyRegulation(Robot model, Gains gains, const Settings& settings)
      : model_(std::move(model)),
        gains_(std::move(gains)),
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
  robot::Model model_;
  Gains gains_;
  Filter filter_;
};

static_assert(OutputFeedbackLaw<KellyRegulation>);

}  // namespace tachless::controller::law

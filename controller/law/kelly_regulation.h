#pragma once

#include <algorithm>
#include <array>
#include <string_view>
#include <tuple>
#include <utility>

#include "controller/law/filter.h"
#include "controller/law/law.h"
#include "controller/law/lyapunov.h"
#include "controller/law/settings.h"
#include "robot/inverse_dynamics.h"
#include "robot/mass_matrix.h"
#include "robot/model.h"
#include "schema/schema.h"

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
class KellyRegulation {
 public:
  static constexpr std::string_view name = "kelly_regulation";
  static constexpr std::array signals = {loop::Signal{"error", "rad"}, loop::Signal{"nu", "rad/s"}};
  static constexpr std::string_view source =
      "R. Kelly, R. Ortega, A. Ailon and A. Loria, Global regulation of flexible joint robots "
      "using approximate differentiation, IEEE Trans. Automatic Control 39(6), 1994, for "
      "rigid joints";
  static constexpr std::string_view proved = "globally asymptotically stable, in continuous time";
  static constexpr std::string_view conditions = "a constant reference; any positive gains";
  static constexpr bool regulation_only = true;
  static constexpr bool has_feedforward_lead = true;

  using Robot = robot::Model;
  using Measurement = loop::PositionMeasurement;
  using Memory = Filter::Memory;

  struct Gains {
    robot::Vector kp, kd, a, b;

    static constexpr std::tuple keys{
        schema::Key{"kp", &Gains::kp, "N m/rad", "Weight of the position error"}.in(
            schema::positive),
        schema::Key{"kd", &Gains::kd, "N m s/rad", "Weight of the filter output"}.in(
            schema::positive),
        schema::Key{"a", &Gains::a, "1/s", "Filter pole"}.in(schema::positive),
        schema::Key{"b", &Gains::b, "1/s", "Filter gain"}.in(schema::positive)};
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

  /// Eq. 15, with epsilon the weight of its cross term.
  static constexpr std::string_view lyapunov_formula =
      "½ ė′Mė + ½ e′Kp e + ½ ν′Kd B⁻¹ν + ε (e − ν)′Mė";
  [[nodiscard]] double lyapunov(const LoopState& state, const loop::ReferencePoint& reference,
                                double epsilon) const {
    const robot::Vector edot = state.v - reference.v_ref;
    return equation_15(state.q - reference.q_ref, edot, state.controller.value[1],
                       robot::mass_matrix(model_, state.q) * edot, gains_.kp,
                       gains_.kd.cwiseQuotient(gains_.b), epsilon);
  }
  [[nodiscard]] double epsilon_bound(double largest_inertia) const {
    return epsilon_bound_by_norms(
        std::min(gains_.kp.minCoeff(), gains_.kd.cwiseQuotient(gains_.b).minCoeff()),
        largest_inertia);
  }

 private:
  robot::Model model_;
  Gains gains_;
  Filter filter_;
};

static_assert(OutputFeedbackLaw<KellyRegulation>);

}  // namespace tachless::controller::law

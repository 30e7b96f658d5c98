#pragma once

#include <array>
#include <string_view>

#include "controller/law/parts.h"
#include "robot/dynamics.h"

namespace tachless::controller::law {

/// Base of the laws for rigid joints that answer the position error by -Kp e - Kd nu, with nudot =
/// -A nu + B edot, and are proved by eq. 15 of Loria and Ortega (1995); no law by itself.
class FilteredError : public RigidLaw<FilterGains> {
 public:
  static constexpr std::array signals{Signal{"error", "rad"}, Signal{"nu", "rad/s"}};

  using Measurement = loop::PositionMeasurement;
  using Memory = Filter::Memory;
  using LawOf::LawOf;

  static Gains tuned(const Tuning& t) {
    return {t.kp(), t.kd(), t.each(t.filter), t.each(t.filter)};
  }

  [[nodiscard]] Memory start(const Measurement& measured, const ReferencePoint& reference) const {
    return filter_.start(measured.q - reference.q_ref);
  }

  static constexpr std::string_view lyapunov_formula =
      "½ ė′Mė + ½ e′Kp e + ½ ν′Kd B⁻¹ν + ε₁ e′Mė − ε₂ ν′Mė";
  [[nodiscard]] double lyapunov(const LoopState& state, const ReferencePoint& reference,
                                const LyapunovWeights& weights) const {
    const Vector edot = state.v - reference.v_ref;
    return equation_15(state.q - reference.q_ref, edot, state.controller.value[1],
                       robot::mass_matrix(robot_, state.q) * edot, gains_.kp,
                       gains_.kd.cwiseQuotient(gains_.b), weights);
  }

 protected:
  /// The step to tau = feedforward - Kp e - Kd nu.
  [[nodiscard]] Step<Memory> step_from(const Memory& memory, const Vector& e,
                                       const Vector& feedforward) const {
    const Memory next = filter_.step(memory, e);
    const Vector tau = feedforward - gains_.kp.cwiseProduct(e) - gains_.kd.cwiseProduct(next.nu);
    return {next, {tau}, {signals.size(), {e, next.nu}}};
  }

 private:
  Filter filter_ = filter(gains_.a, gains_.b);
};

}  // namespace tachless::controller::law

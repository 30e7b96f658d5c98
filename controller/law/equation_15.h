#pragma once

#include <string_view>
#include <utility>

#include "controller/law/filter_gains.h"
#include "controller/law/lyapunov.h"
#include "controller/law/tuning.h"
#include "robot/mass_matrix.h"
#include "robot/model.h"

namespace tachless::controller::law {

/// Eq. 15 of Loria and Ortega (1995): the Lyapunov function of a rigid robot under -Kp e - Kd nu.
/// Base of the laws that are proved by it, each of which logs e and nu; computes no command.
class Equation15 {
 public:
  using Gains = FilterGains;
  using Robot = robot::Model;  ///< rotor inertia included: M = M_l + J

  static Gains tuned(const Tuning& t) {
    return {t.kp(), t.kd(), t.each(t.filter), t.each(t.filter)};
  }

  static constexpr std::string_view lyapunov_formula =
      "½ ė′Mė + ½ e′Kp e + ½ ν′Kd B⁻¹ν + ε₁ e′Mė − ε₂ ν′Mė";

  /// [J]
  [[nodiscard]] double lyapunov(const LoopState& state, const loop::ReferencePoint& reference,
                                const LyapunovWeights& weights) const {
    const robot::Vector edot = state.v - reference.v_ref;
    return equation_15(state.q - reference.q_ref, edot, state.controller.value[1],
                       robot::mass_matrix(model_, state.q) * edot, gains_.kp,
                       gains_.kd.cwiseQuotient(gains_.b), weights);
  }

 protected:
  Equation15(Robot model, Gains gains) : model_(std::move(model)), gains_(std::move(gains)) {}

  robot::Model model_;
  Gains gains_;
};

}  // namespace tachless::controller::law

#pragma once

#include <concepts>
#include <string_view>

#include "loop/signals.h"

/// How a law declares the Lyapunov function by which its stability is proved. It is a function of
/// the true state, which no law's `step` is given: certificate/ evaluates it afterwards.
namespace tachless::controller::law {

/// The whole state of a closed loop at one instant; on a rigid robot `theta` and `thetadot` are
/// empty.
struct LoopState {
  robot::Vector q, v, theta, thetadot;
  loop::LawSignals controller;  ///< what the law logged for the same tick
};

/// The weights of the cross terms of V: eps_1 e' M edot - eps_2 nu' M edot. The paper's V (eq. 15)
/// has one weight: eps_1 [1/s] and eps_2 [1] both epsilon.
struct LyapunovWeights {
  double eps_1 = 0;
  double eps_2 = 0;
};

/// A law with a Lyapunov function: its formula for people, and its value [J]; a function without
/// cross terms ignores the weights.
template <class L>
concept HasLyapunovFunction = requires(const L& law, const LoopState& state,
                                       const loop::ReferencePoint& reference,
                                       const LyapunovWeights& weights) {
  { L::lyapunov_formula } -> std::convertible_to<std::string_view>;
  { law.lyapunov(state, reference, weights) } -> std::same_as<double>;
};

/// x' diag(d) x.
inline double weighted(const robot::Vector& d, const robot::Vector& x) {
  return x.dot(d.cwiseProduct(x));
}

/// Eq. 15 of Loria and Ortega (1995) for a rigid robot, with two weights [J]: 1/2 edot' M edot +
/// 1/2 e' Kp e + 1/2 nu' Kd B^-1 nu + (eps_1 e - eps_2 nu)' M edot, with `momentum` = M edot.
inline double equation_15(const robot::Vector& e, const robot::Vector& edot,
                          const robot::Vector& nu, const robot::Vector& momentum,
                          const robot::Vector& kp, const robot::Vector& kd_by_b,
                          const LyapunovWeights& weights) {
  return 0.5 * edot.dot(momentum) + 0.5 * weighted(kp, e) + 0.5 * weighted(kd_by_b, nu) +
         (weights.eps_1 * e - weights.eps_2 * nu).dot(momentum);
}

}  // namespace tachless::controller::law

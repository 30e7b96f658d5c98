#pragma once

#include <cmath>
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

/// A law with a Lyapunov function: its formula for people, and its value [J]. `epsilon` is the
/// weight of the cross term; a function that has none ignores it.
template <class L>
concept HasLyapunovFunction = requires(const L& law, const LoopState& state,
                                       const loop::ReferencePoint& reference, double epsilon) {
  { L::lyapunov_formula } -> std::convertible_to<std::string_view>;
  { law.lyapunov(state, reference, epsilon) } -> std::same_as<double>;
};

/// One with a cross term: the weight below which the function is positive definite by norms, given
/// the largest eigenvalue of the links' inertia matrix over all postures.
template <class L>
concept HasCrossTerm = HasLyapunovFunction<L> && requires(const L& law, double largest_inertia) {
  { law.epsilon_bound(largest_inertia) } -> std::same_as<double>;
};

/// x' diag(d) x.
inline double weighted(const robot::Vector& d, const robot::Vector& x) {
  return x.dot(d.cwiseProduct(x));
}

/// sqrt(min(lambda(Kp), lambda(Kd B^-1)) / (2 Lambda(M))): twice the smaller of the bounds (19) and
/// (20) of Loria and Ortega (1995).
inline double epsilon_bound_by_norms(double smallest_stiffness, double largest_inertia) {
  return std::sqrt(smallest_stiffness / (2 * largest_inertia));
}

/// Eq. 15 of Loria and Ortega (1995) for a rigid robot [J]: 1/2 edot' M edot + 1/2 e' Kp e +
/// 1/2 nu' Kd B^-1 nu + eps (e - nu)' M edot, with `momentum` = M edot.
inline double equation_15(const robot::Vector& e, const robot::Vector& edot,
                          const robot::Vector& nu, const robot::Vector& momentum,
                          const robot::Vector& kp, const robot::Vector& kd_by_b, double epsilon) {
  return 0.5 * edot.dot(momentum) + 0.5 * weighted(kp, e) + 0.5 * weighted(kd_by_b, nu) +
         epsilon * (e - nu).dot(momentum);
}

}  // namespace tachless::controller::law

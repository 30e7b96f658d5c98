#pragma once

#include <functional>
#include <optional>
#include <string>

#include "experiment/scenario.h"
#include "loop/signals.h"

namespace tachless::certificate {

/// The whole state of a closed loop at one instant; on a rigid robot `theta` and `thetadot` are
/// empty.
struct LoopState {
  robot::Vector q, v, theta, thetadot;
  loop::LawSignals controller;  ///< of the same tick
};

/// The Lyapunov function by which a law's stability is proved.
struct LyapunovFunction {
  std::string formula;  ///< for people
  /// Of the cross term; 5 % of sqrt(min(lambda_min Kp, lambda_min Kd B^-1) / (2 lambda_max M)),
  /// below which V is positive definite by norms. 0 where the function has no cross term.
  double epsilon = 0;
  /// V [J].
  std::function<double(const LoopState&, const loop::ReferencePoint&)> at;
};

/// That of the scenario's law, with the model that the law is given (a payload unknown to it is
/// not in M). Nothing for laws other than these:
///
/// loria_ortega_rigid, kelly_regulation (Loria and Ortega, eq. 15):
///   V = 1/2 edot' M edot + 1/2 e' Kp e + 1/2 nu' Kd B^-1 nu + eps (e - nu)' M edot;
/// loria_ortega_flexible: the same with e = (e1, e2), nu = (nu1, nu2), M = blockdiag(M_l, J),
///   Kp = [Kp1 + K, -K; -K, Kp2 + K], Kd and B block diagonal; theta_ref and its derivative are
///   evaluated at the true state;
/// kelly_flexible (Kelly, Ortega, Ailon and Loria, 1994), with U the potential energy:
///   V = 1/2 v' M_l v + 1/2 thetadot' J thetadot + 1/2 e' [K, -K; -K, K + Kp] e + U(q) - U(q_ref)
///       - g(q_ref)' e1 + 1/2 nu' Kd B^-1 nu.
/// @throw diagnostics::Failure(bad_usage) when the law cannot be made of the scenario.
std::optional<LyapunovFunction> lyapunov_function(const experiment::Scenario& scenario);

}  // namespace tachless::certificate

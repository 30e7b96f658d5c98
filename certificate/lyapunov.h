#pragma once

#include <functional>
#include <optional>
#include <string>

#include "controller/law/lyapunov.h"
#include "experiment/scenario.h"

/// The Lyapunov functions that laws declare, with a scenario's robot and gains. Certifies nothing.
namespace tachless::certificate {

using controller::law::LoopState;

/// The Lyapunov function by which a law's stability is proved.
struct LyapunovFunction {
  std::string formula;  ///< for people
  /// Of the cross term: 5 % of the weight below which V is positive definite by norms
  /// (controller/law/lyapunov.h), with lambda_max(M) the largest over 256 sampled postures. 0 where
  /// the function has no cross term.
  double epsilon = 0;
  /// V [J].
  std::function<double(const LoopState&, const loop::ReferencePoint&)> at;
};

/// That of the scenario's law, with the model that the law is given (a payload unknown to it is
/// not in M). Nothing when the law declares none.
/// @throw diagnostics::Failure(bad_usage) when the law cannot be made of the scenario.
std::optional<LyapunovFunction> lyapunov_function(const experiment::Scenario& scenario);

}  // namespace tachless::certificate

#pragma once

#include <functional>
#include <optional>
#include <string>

#include "certificate/stability_certificate.h"
#include "controller/law/lyapunov.h"
#include "experiment/scenario.h"

/// The Lyapunov functions that laws declare, with a scenario's robot and gains, and what is
/// certified of them along its run.
namespace tachless::certificate {

using controller::law::LoopState;

/// The Lyapunov function by which a law's stability is proved.
struct LyapunovFunction {
  std::string formula;  ///< for people
  /// Its weights and a bound; without it V has no cross terms, or their weights are 0.
  std::optional<CertifiedRun> certified;
  /// V [J].
  std::function<double(const LoopState&, const loop::ReferencePoint&)> at;
};

/// That of the scenario's law, with the model that the law is given (a payload unknown to it is
/// not in M). Nothing when the law declares none.
/// @throw diagnostics::Failure(bad_usage) when the law cannot be made of the scenario.
std::optional<LyapunovFunction> lyapunov_function(const experiment::Scenario& scenario);

}  // namespace tachless::certificate

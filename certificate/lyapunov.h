#pragma once

#include <functional>
#include <optional>
#include <string>

#include "certificate/error_system.h"
#include "controller/law/law.h"
#include "experiment/scenario.h"

/// The Lyapunov functions that laws declare, with a scenario's robot and gains. Certifies nothing.
namespace tachless::certificate {

using controller::law::LoopState;

/// The Lyapunov function by which a law's stability is proved.
struct LyapunovFunction {
  std::string formula;  ///< for people
  /// V [J].
  std::function<double(const LoopState&, const loop::ReferencePoint&)> at;
};

/// That of the scenario's law, with the model that the law is given (a payload unknown to it is
/// not in M). Nothing when the law declares none.
/// @param weights of its cross terms, where it has some: those of `certified_run`
/// @throw diagnostics::Failure(bad_usage) when the law cannot be made of the scenario.
std::optional<LyapunovFunction> lyapunov_function(const experiment::Scenario& scenario,
                                                  const Weights& weights = {});

}  // namespace tachless::certificate

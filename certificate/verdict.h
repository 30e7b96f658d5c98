#pragma once

#include <optional>
#include <string>

#include "experiment/scenario.h"

/// Is a scenario's sampled loop stable? In well under 0.1 s, before a run. The whole answer is
/// certify.h's.
namespace tachless::certificate {

struct Verdict {
  std::string unknown;  ///< why the law cannot be linearised; empty: it can, and the rest holds
  bool stable = false;  ///< of the linearised loop at the scenario's period
  double period_s = 0;
  int delay = 0;
  std::optional<double> limit_s;  ///< largest stable period that was found; nothing: none
  double phase_margin_deg = 0;    ///< of a stable loop
  double settles_s = 0;           ///< to 1 % of an error in all joints
  double growth_per_s = 0;        ///< of an unstable loop
};

/// Of the linearised loop, at rest at postures of the reference and over its motion. Says nothing
/// of large errors, saturation or quantisation.
/// @throw diagnostics::Failure(bad_usage) when law, robot or reference cannot be made of it.
Verdict verdict(const experiment::Scenario& scenario);

/// "stable at 1 kHz: limit 3.6 ms, phase margin 50°, settles in 0.2 s", "unstable at 1 kHz: …".
std::string text(const Verdict& verdict);

/// Why a run is refused, and what to type: limit, a stable period nearby. Of an unstable loop.
std::string refusal(const Verdict& verdict, const std::string& scenario_file);

}  // namespace tachless::certificate

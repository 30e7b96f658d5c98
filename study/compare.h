#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "experiment/scenario.h"
#include "study/envelope.h"
#include "study/measures.h"

/// One scenario under one law, in the numbers by which laws are compared. Chooses no laws and tunes
/// none.
namespace tachless::study {

struct Compared {
  std::string law;
  std::string_view measures;  ///< what it is fed: POSITION, STATE, …
  Measures run;               ///< of the first seed
  double least_settled_error = 0, largest_settled_error = 0;  ///< over the seeds [rad; m]
  /// Root mean square of what encoders and their noise add to the torque, over that of their errors
  /// [N m/rad]; nothing with exact encoders, or when the run was broken off.
  std::optional<double> noise_amplification;
  /// The shortest over postures of the reference [s]; nothing when the law has no linearisation, or
  /// no period is stable.
  std::optional<double> largest_period_s;
  double step_us = 0;      ///< time that the law takes for a tick, here [us]
  Envelope error, torque;  ///< norms over time [rad; m], [N m; N]
};

/// @param seeds of the encoders' noise, from the scenario's own on; at least 1
/// @throw diagnostics::Failure(bad_usage) for a scenario that makes no sense.
Compared compare(const experiment::Scenario& scenario, int seeds);

}  // namespace tachless::study

#pragma once

#include <cstdint>

#include "experiment/scenario.h"

namespace tachless::study {

/// How far Simbody and the library's own mechanics are apart over a run.
struct CrossCheck {
  std::int64_t ticks = 0;  ///< compared
  // Largest difference of a true value, of links and motors; of values above 1 relative to them.
  double position = 0;    ///< [rad; m]
  double velocity = 0;    ///< [rad/s; m/s]
  std::int64_t tick = 0;  ///< of the largest in position
};

/// The closed loop of the scenario stepped twice in this process, with plant.mechanics simbody and
/// native, compared tick by tick. Both with ideal encoders (a difference of rounding would turn
/// into one of a count) and at an accuracy of 1e-12 or the scenario's, whichever is finer.
/// @throw diagnostics::Failure as `run_in_process`, and (bad_usage) for a scenario that only one of
/// them can move
CrossCheck cross_check(const experiment::Scenario& scenario);

}  // namespace tachless::study

#pragma once

#include "design/design.h"

namespace tachless::design {

/// Error of the start from which an arm has to come back [rad; m]. A joint with a shorter range
/// starts a quarter of its range beside the motion.
inline constexpr double far_start_error = 0.3;

/// Returns whether the arm comes back from a start beside its motion, with the designed gains. All
/// joints start `far_start_error` from the motion's start, towards the middle of their ranges.
/// Torque limits are those of the scenario; speeds and positions are not limited, and the encoders
/// are exact. A run without a bus and without Simbody decides: the arm is back if no error of the
/// run's second half exceeds a twentieth of the largest one at the start. An arm whose run the
/// plant stops is not back.
bool returns_from_beside(const scenario::Scenario& scenario, const Design& design);

}  // namespace tachless::design

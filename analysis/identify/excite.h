#pragma once

#include <string>
#include <vector>

#include "identify/output_error.h"
#include "identify/parameters.h"
#include "scenario/scenario.h"

namespace tachless::identify {

/// A motion that excites the unknown parameters.
struct Excitation {
  std::vector<std::string> overrides;  ///< the reference as waypoints, and the run's duration
  double condition = 0;                ///< of the regression with scaled columns
  Vector reach;                        ///< largest deflection of each joint from the start [rad; m]
  Vector speed;                        ///< largest [rad/s; m/s]
  Vector torque;                       ///< largest, with the scenario's parameters [N m; N]
};

struct ExcitationGoal {
  double duration_s = 20;
  double reach = 0.5;  ///< largest deflection from the start [rad; m]
};

/// Designs a motion of several sines per joint. It begins and ends at rest at the scenario's
/// initial posture. It stays within nine tenths of the joints' ranges and four fifths of their
/// torque limits. It stays within four fifths of their speed limits (1 rad/s, 1 m/s where the URDF
/// has none). The function draws 60 motions at random and returns the motion with the
/// best-conditioned regression. It does not consider obstacles.
/// @throw base::Failure(bad_usage) for flexible joints, for a joint that begins at its limit, and
/// when none of the motions stays within the torque limits
Excitation excite(const scenario::Scenario& scenario, const std::vector<Kind>& unknown,
                  const ExcitationGoal& goal, const Report& report);

}  // namespace tachless::identify

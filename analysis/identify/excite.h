#pragma once

#include <string>
#include <vector>

#include "identify/output_error.h"
#include "identify/parameters.h"
#include "scenario/scenario.h"

namespace tachless::identify {

/// A motion that shows what is unknown.
struct Excitation {
  std::vector<std::string> overrides;  ///< the reference as waypoints, and the run's duration
  double condition = 0;                ///< of the regression, columns scaled
  Vector reach;                        ///< of each joint from the start [rad; m]
  Vector speed;                        ///< largest [rad/s; m/s]
  Vector torque;                       ///< largest, of the arm as the scenario has it [N m; N]
};

struct ExcitationGoal {
  double duration_s = 20;
  double reach = 0.5;  ///< at most this far from the start [rad; m]
};

/// Several sines per joint, from rest to rest at the scenario's initial posture, within nine tenths
/// of the joints' ranges, four fifths of their speeds (1 rad/s, 1 m/s where the URDF has none) and
/// torques. Of 60 drawn at random the one whose regression has the least condition. Knows no
/// obstacles.
/// @throw base::Failure(bad_usage) for flexible joints, where a joint begins at its limit,
/// and where none of the motions keeps to the torques
Excitation excite(const scenario::Scenario& scenario, const std::vector<Kind>& unknown,
                  const ExcitationGoal& goal, const Report& report);

}  // namespace tachless::identify

#pragma once

#include <optional>
#include <string>
#include <vector>

#include "identify/output_error.h"
#include "identify/parameters.h"
#include "identify/separation.h"
#include "scenario/scenario.h"

namespace tachless::identify {

/// A motion that excites the unknown parameters.
struct Excitation {
  /// Predicted half width of an unknown's 95 % interval. It is infinite if the motion determines
  /// the unknown only in a sum with others.
  struct Width {
    std::string name, unit;
    double half_width;
  };
  std::vector<std::string> overrides;  ///< the reference as waypoints, and the run's duration
  /// Widths of the unknowns other than links' parameters, with torque noise of `noise_share`.
  std::vector<Width> widths;
  /// Condition number of the regression's determined part, columns scaled to norm 1.
  double condition = 0;
  Vector reach;   ///< largest deflection of each joint from the start [rad; m]
  Vector speed;   ///< largest speed of each joint [rad/s; m/s]
  Vector torque;  ///< largest torque of each joint, with the scenario's parameters [N m; N]
  std::optional<Separation::Pair> nearest;     ///< links that come nearest to each other
  std::vector<Separation::Pair> not_compared;  ///< links whose shapes meet at the start
};

/// Goals of an excitation.
struct ExcitationGoal {
  double duration_s = 20;
  double reach = 0.5;  ///< largest deflection from the start [rad; m]
  /// Height above the origin of the URDF's root link above which every link's origin stays [m].
  std::optional<double> floor;
  /// Least distance of links that no joint connects [m]. It concerns the links whose shapes are
  /// primitives of `shapes` (separation.h).
  double clearance = 0.02;
  /// Text of the robot's URDF with its shapes; empty: distances do not count.
  std::string shapes = {};
};

/// Torque noise of the prediction, as a share of each joint's torque limit. For a joint without a
/// limit it is a share of the largest torque in the first motion.
inline constexpr double noise_share = 0.01;

/// Designs a motion of several sines per joint. It begins and ends at rest at the scenario's
/// initial posture. It stays within nine tenths of the joints' ranges and four fifths of their
/// torque limits. It stays within four fifths of their speed limits (1 rad/s, 1 m/s where the URDF
/// has none). The function maximises the determinant of the information on the unknowns
/// (D-optimality). If links are unknown, a small condition number counts too. The function first
/// draws Fourier series at random. It then changes the series of one joint of the best motion at a
/// time. It considers a floor and distances between links, and no other obstacles.
/// @throw base::Failure(bad_usage) for flexible joints, for a joint that begins at its limit, for
/// links that are nearer to each other at the start than the clearance, for shapes that are not
/// readable, and when no motion keeps the torque limits, the floor and the clearance
Excitation excite(const scenario::Scenario& scenario, const std::vector<Kind>& unknown,
                  const ExcitationGoal& goal, const Report& report);

}  // namespace tachless::identify

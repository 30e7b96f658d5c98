#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <utility>
#include <vector>

#include "robot/model.h"

/// A robot as parsed from its URDF, with its mechanics at one position, for `tachless robot`.
/// Rotors and payload are not included. Gravity is the model's.
namespace tachless::report {

/// Facts on a robot at `position`. An empty `position` puts each joint as near to 0 as its range
/// allows.
/// @throw base::Failure(bad_usage) unless `position` is empty or has one number per joint
struct RobotFacts {
  RobotFacts(robot::Model read, const std::vector<double>& position);

  robot::Model model;
  Vector q;               ///< [rad; m]
  Matrix inertia;         ///< M(q) [kg m2; kg m; kg]
  Vector gravity_torque;  ///< g(q) [N m; N]
  double mass_kg = 0;     ///< mass of the moving bodies
  /// Condition number of M(q) in SI units, also for mixed joint types.
  double condition_number = 0;
  std::vector<std::string> warnings;  ///< the model's warnings, and joints outside their range
  Vector rotor_inertia;               ///< [kg m2]; `inertia` includes it for rigid joints alone
  /// Names of numbers, and the scenario's key or the URDF's element that each comes from. Empty for
  /// a URDF alone.
  std::vector<std::pair<std::string, std::string>> sources;
};

/// Returns text: a table of the joints, the inertia matrix (for up to ten joints) and the warnings.
std::string to_text(const RobotFacts& facts);

/// Returns JSON. A missing limit is null.
nlohmann::ordered_json to_json(const RobotFacts& facts);

}  // namespace tachless::report

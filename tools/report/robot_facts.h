#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <utility>
#include <vector>

#include "robot/model.h"

/// A robot as parsed from its URDF, and its mechanics at one position: the content of
/// `tachless robot`: without rotors and payload, gravity as in the model.
namespace tachless::report {

/// @throw base::Failure(bad_usage) unless `position` is empty (each joint as near to 0 as
/// its range allows) or has one number per joint
struct RobotFacts {
  RobotFacts(robot::Model read, const std::vector<double>& position);

  robot::Model model;
  Vector q;                           ///< [rad; m]
  Matrix inertia;                     ///< M(q) [kg m2; kg m; kg]
  Vector gravity_torque;              ///< g(q) [N m; N]
  double mass_kg = 0;                 ///< of what moves
  double condition_number = 0;        ///< of M(q), in SI units whatever the joints are
  std::vector<std::string> warnings;  ///< the model's, and joints outside their range
  Vector rotor_inertia;               ///< [kg m2]; of flexible joints it is not in `inertia`
  /// What of the numbers, and its source: a key and a place in a file. Empty for a bare URDF.
  std::vector<std::pair<std::string, std::string>> sources;
};

/// For people: a table of the joints, the inertia matrix (of up to ten joints) and the warnings.
std::string to_text(const RobotFacts& facts);

/// For programs. A limit that there is not is null.
nlohmann::ordered_json to_json(const RobotFacts& facts);

}  // namespace tachless::report

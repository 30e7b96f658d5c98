#pragma once

#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace tachless::robot {

/// A robot's description as the text of a URDF, with the facts that a URDF does not hold.
struct Description {
  std::string urdf;
  std::string mjcf;                     ///< text of the MuJoCo model it was made of; empty: none
  std::vector<std::string> warnings;    ///< each with its source
  std::map<std::string, double> start;  ///< posture of an MJCF's keyframe, by joint [rad; m]
  bool adds_gravity = false;            ///< each body that moves has gravcomp="1"
};

/// Function from the name of an included file, as the MJCF has it, to the file's text.
using IncludedText = std::function<std::string(const std::string& file)>;

/// Returns whether the root element of an XML text is <mujoco>.
bool is_mjcf(std::string_view text);

/// Reads a MuJoCo model (MJCF) and returns the URDF with the same mechanics. Follows includes and
/// applies the defaults of classes. Each body is a link with its body frame. Reads joints,
/// inertials, masses of primitive geoms, ranges, damping, frictionloss, armature and force limits.
/// A linear <equality><joint> becomes a mimic joint. Geoms of the groups 0 to 2 become visuals. A
/// free body that carries no joint of an arm is left out, with a warning.
/// @param source name of the file, for messages
/// @throw std::invalid_argument, one line with file, line, element, value and remedy, for an
/// unknown element or attribute, and for mechanics that a URDF cannot hold
Description description_of_mjcf(const std::string& text, const std::string& source,
                                const IncludedText& included);

}  // namespace tachless::robot

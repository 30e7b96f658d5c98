#pragma once

#include <string_view>
#include <vector>

namespace tachless::robot {

/// Names of MuJoCo's attributes and children of one element.
struct MjcfRule {
  std::vector<std::string_view> attributes;
  std::vector<std::string_view> children;  ///< children that are read
  std::vector<std::string_view> others;    ///< children without mechanics of a robot; not read
  std::vector<std::string_view> refused;   ///< children with mechanics; not read
};

/// Returns the rule of an element, for example "body" or "equality/joint". The element must have
/// one.
const MjcfRule& mjcf_rule(std::string_view element);

/// Returns whether an element of <actuator>, or of a <default>, is an actuator.
bool is_mjcf_actuator(std::string_view element);

}  // namespace tachless::robot

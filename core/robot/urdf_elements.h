#pragma once

#include <string_view>
#include <vector>

namespace tachless::robot {

/// Children and attributes of a URDF element that is read.
struct ElementRule {
  std::vector<std::string_view> children;  ///< children that are read, at most one of each
  std::vector<std::string_view> others;    ///< children that URDF or a known dialect has; not read
  std::vector<std::string_view> attributes;  ///< attributes that URDF has
};

/// Returns the rule of `element`; nothing for an element that is not read.
const ElementRule* rule_of(std::string_view element);

/// Returns whether an attribute of this name has mechanics in it, such as rpy.
bool is_mechanics(std::string_view attribute);

/// Returns the names of the children of <robot> that URDF or a known dialect has.
const std::vector<std::string_view>& robot_children();

}  // namespace tachless::robot

#pragma once

#include <map>
#include <string>

/// What is read from a URDF's XML before urdfdom sees it; no geometry and no inertia.
namespace tachless::robot {

/// Throws std::invalid_argument "<source>: <problem>", on one line.
[[noreturn]] void refuse_urdf(const std::string& source, const std::string& problem);

/// The place of each joint in the file, by name, which urdfdom does not keep.
/// @throw std::invalid_argument on malformed XML, duplicated or missing names, and joints that
/// close a chain: urdfdom accepts some of these, and its links own each other, so that a cycle
/// would never be freed.
std::map<std::string, int> joint_order(const std::string& text, const std::string& source);

}  // namespace tachless::robot

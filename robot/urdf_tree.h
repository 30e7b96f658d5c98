#pragma once

#include <map>
#include <set>
#include <string>
#include <vector>

/// What is done with a URDF's XML before urdfdom sees it; no geometry and no inertia.
namespace tachless::robot {

/// Throws std::invalid_argument "<source>: <problem>", on one line.
[[noreturn]] void refuse_urdf(const std::string& source, const std::string& problem);

struct UrdfXml {
  /// `urdf_mechanics` (model.h) of the file, with what urdfdom cannot do without filled in.
  std::string text;
  std::map<std::string, std::vector<std::string>> joints_below;  ///< by link, in the file's order
  std::set<std::string> joints_without_range;  ///< neither lower nor upper is given
  std::vector<std::string> warnings;           ///< what was filled in
};

/// @param locked joints that are to be fixed; their type may be any, at position 0
/// @throw std::invalid_argument on malformed XML, what xacro has left, duplicated or missing names,
/// unsupported types, and joints that close a chain: urdfdom accepts some of these, and its links
/// own each other, so that a cycle would never be freed.
UrdfXml read_urdf_xml(const std::string& text, const std::string& source,
                      const std::map<std::string, double>& locked);

}  // namespace tachless::robot

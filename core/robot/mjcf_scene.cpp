#include "robot/mjcf_scene.h"

#include <algorithm>

#include "robot/mjcf_document.h"

namespace tachless::robot {
namespace {

/// Returns whether a hinge or slide joint is in this body or in those that it carries.
bool carries_a_joint(const MjcfDocument& document, const XmlElement& body) {
  return std::ranges::any_of(document.children(body), [&](const XmlElement* each) {
    const std::string& kind = name_of(*each);
    if (kind == "joint") {
      const std::string type = document.attributes(*each, "main").text("type", "hinge");
      return type == "hinge" || type == "slide";
    }
    return (kind == "body" || kind == "frame") && carries_a_joint(document, *each);
  });
}

/// Returns whether a child of the world, or of a frame in it, is no part of the robot.
bool is_beside_robot(const MjcfDocument& document, const XmlElement& child) {
  const std::string& kind = name_of(child);
  if (kind == "geom") return true;
  if (kind == "body") return !carries_a_joint(document, child);
  return kind == "frame" &&
         std::ranges::any_of(document.children(child), [&](const XmlElement* each) {
           return is_beside_robot(document, *each);
         });
}

/// Adds the names of the <include> elements below an element.
void add_included(const XmlElement& parent, std::vector<std::string>& files) {
  for (const auto* e = parent.FirstChildElement(); e; e = e->NextSiblingElement()) {
    const char* const file = e->Attribute("file");
    if (name_of(*e) == "include" && file != nullptr) files.emplace_back(file);
    add_included(*e, files);
  }
}

}  // namespace

bool has_surroundings(const std::string& text, const std::string& source,
                      const IncludedText& included) {
  const MjcfDocument document(text, source, included);
  return std::ranges::any_of(document.in_sections("worldbody"), [&](const XmlElement* each) {
    return is_beside_robot(document, *each);
  });
}

std::vector<std::string> included_files(const std::string& text) {
  XmlDocument document;
  std::vector<std::string> files;
  if (parse_xml(text, document).empty()) add_included(*document.RootElement(), files);
  return files;
}

}  // namespace tachless::robot

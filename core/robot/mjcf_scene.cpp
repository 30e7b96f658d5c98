#include "robot/mjcf_scene.h"

#include <algorithm>

#include "robot/mjcf_document.h"
#include "robot/urdf_xml.h"

namespace tachless::robot {
namespace {

/// Returns whether a hinge or slide joint is in this body or in those that it carries.
bool carries_a_joint(const MjcfDocument& document, const TiXmlElement& of) {
  return std::ranges::any_of(document.children(of), [&](const TiXmlElement* each) {
    const std::string& kind = each->ValueStr();
    if (kind == "joint") {
      const std::string type = document.attributes(*each, "main").text("type", "hinge");
      return type == "hinge" || type == "slide";
    }
    return (kind == "body" || kind == "frame") && carries_a_joint(document, *each);
  });
}

/// Returns whether a child of the world, or of a frame in it, is no part of the robot.
bool is_beside_robot(const MjcfDocument& document, const TiXmlElement& child) {
  const std::string& kind = child.ValueStr();
  if (kind == "geom") return true;
  if (kind == "body") return !carries_a_joint(document, child);
  return kind == "frame" &&
         std::ranges::any_of(document.children(child), [&](const TiXmlElement* each) {
           return is_beside_robot(document, *each);
         });
}

/// Adds the names of the <include> elements below an element.
void add_included(const TiXmlElement& of, std::vector<std::string>& files) {
  for (const auto* e = of.FirstChildElement(); e; e = e->NextSiblingElement()) {
    const char* const file = e->Attribute("file");
    if (e->ValueStr() == "include" && file != nullptr) files.emplace_back(file);
    add_included(*e, files);
  }
}

}  // namespace

bool has_surroundings(const std::string& text, const std::string& source,
                      const IncludedText& included) {
  const MjcfDocument document(text, source, included);
  return std::ranges::any_of(document.in_sections("worldbody"), [&](const TiXmlElement* each) {
    return is_beside_robot(document, *each);
  });
}

std::vector<std::string> included_files(const std::string& text) {
  if (!why_too_large(text).empty()) return {};
  TiXmlDocument document;
  document.Parse(text.c_str(), nullptr, TIXML_ENCODING_UTF8);
  std::vector<std::string> files;
  if (document.RootElement() != nullptr) add_included(*document.RootElement(), files);
  return files;
}

}  // namespace tachless::robot

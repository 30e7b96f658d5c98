#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <string_view>
#include <tuple>

#include "base/text.h"
#include "robot/urdf_xml.h"
#include "robot/xml.h"

namespace tachless::robot {

std::string urdf_with_inertials(const std::string& text,
                                const std::map<std::string, MassProperties>& links) {
  XmlDocument document;
  parse_xml(urdf_mechanics(text, "URDF"), document);
  XmlElement* const robot = document.FirstChildElement("robot");
  for (auto* link = robot->FirstChildElement("link"); link;
       link = link->NextSiblingElement("link")) {
    const auto found = links.find(link->Attribute("name"));
    if (found == links.end()) continue;
    while (XmlElement* old = link->FirstChildElement("inertial")) link->DeleteChild(old);
    const auto& [mass, p, I] = found->second;
    if (mass == 0 && I.isZero(0)) continue;
    XmlElement& inertial = add(*link, "inertial");
    add(inertial, "origin", "xyz", fmt::format("{} {} {}", p.x(), p.y(), p.z()));
    add(inertial, "mass", "value", fmt::format("{}", mass));
    add_inertia(inertial, I);
  }
  return xml_text(document, true);
}

bool is_urdf_name(std::string_view text) {
  constexpr std::string_view forbidden = "\"'`\\<>&$;|{}[],*?!~^%=";
  return text.size() <= 200 && base::printable(text) == text &&
         text.find_first_of(forbidden) == std::string_view::npos &&
         std::string_view("+-@#: ").find(text.front()) == std::string_view::npos;
}

std::string xml_kind(std::string_view text, const std::string& source) {
  const auto has = [&](std::string_view mark) { return text.find(mark) != std::string_view::npos; };
  if (has("<mujoco")) {
    return fmt::format(
        "a model of MuJoCo; tachless design {} --write SCENARIO.yaml makes a "
        "scenario of it",
        base::shell_word(source));
  }
  if (has("<sdf")) return "an SDF file (the URDF that it was made from would do)";
  if (!has("<robot")) return "not a robot's description";
  if (!has("xmlns:xacro") || !source.ends_with(".xacro")) {
    return fmt::format("a URDF; tachless design {} --write SCENARIO.yaml makes a scenario of it",
                       base::shell_word(source));
  }
  return fmt::format("a file for xacro; run xacro {} > robot.urdf and give robot.urdf",
                     base::shell_word(source));
}

}  // namespace tachless::robot

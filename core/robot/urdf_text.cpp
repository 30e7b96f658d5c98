#include <fmt/format.h>
#include <tinyxml.h>

#include <algorithm>
#include <cctype>
#include <string>
#include <string_view>
#include <tuple>

#include "base/file_text.h"
#include "base/text.h"
#include "robot/urdf_xml.h"

namespace tachless::robot {
namespace {

/// How deep TinyXML, which recurses and takes quadratic time, would go, and how many attributes an
/// element has at most. Exact for what it accepts; where it stops at an error, at least as much.
struct Nesting {
  int depth = 0, attributes = 0;
};

Nesting nesting_of(std::string_view text) {
  Nesting most;
  int depth = 0;
  const auto skip_past = [&](std::size_t from, std::string_view end) {
    const std::size_t found = text.find(end, from);
    return found == std::string_view::npos ? text.size() : found + end.size();
  };
  for (std::size_t at = text.find('<'); at < text.size(); at = text.find('<', at)) {
    const std::string_view rest = text.substr(at);
    const unsigned char first = rest.size() > 1 ? static_cast<unsigned char>(rest[1]) : 0;
    if (rest.starts_with("<!--")) {
      at = skip_past(at + 4, "-->");
    } else if (rest.starts_with("<![CDATA[")) {
      at = skip_past(at, "]]>");
    } else if (first == '/') {
      depth = std::max(0, depth - 1);
      ++at;
    } else if (std::isalpha(first) != 0 || first == '_' || first >= 127) {
      int attributes = 0;
      for (++at; at < text.size() && text[at] != '>'; ++at) {
        if (text[at] == '=') ++attributes;
        if (text[at] == '"' || text[at] == '\'') at = skip_past(at + 1, text.substr(at, 1)) - 1;
      }
      if (at >= text.size() || text[at - 1] != '/') ++depth;
      most = {std::max(most.depth, depth), std::max(most.attributes, attributes)};
    } else {
      at = skip_past(at, ">");
    }
  }
  return most;
}

}  // namespace

std::string why_too_large(std::string_view text) {
  constexpr int max_depth = 64, max_attributes = 64;
  if (text.size() > base::max_text_bytes) {
    return fmt::format("{} bytes; allowed: at most {}", text.size(), base::max_text_bytes);
  }
  const Nesting nesting = nesting_of(text);
  if (nesting.depth <= max_depth && nesting.attributes <= max_attributes) return "";
  return fmt::format(
      "elements nested {} deep, {} attributes in one; allowed: {} levels, {} attributes",
      nesting.depth, nesting.attributes, max_depth, max_attributes);
}

int line_of_unread_markup(const TiXmlNode& node) {
  for (const auto* each = node.FirstChild(); each != nullptr; each = each->NextSibling()) {
    const std::string& value = each->ValueStr();
    const bool allowed =
        node.ToDocument() != nullptr && (value.starts_with("!DOCTYPE") || value.starts_with('?'));
    if (each->ToUnknown() != nullptr && !allowed) {
      return std::max(each->Row(), 1);
    }
    if (const int line = line_of_unread_markup(*each); line != 0) return line;
  }
  return 0;
}

std::string urdf_with_inertials(const std::string& text,
                                const std::map<std::string, MassProperties>& links) {
  TiXmlDocument document;
  document.Parse(urdf_mechanics(text, "URDF").c_str(), nullptr, TIXML_ENCODING_UTF8);
  TiXmlElement* const robot = document.FirstChildElement("robot");
  for (auto* link = robot->FirstChildElement("link"); link;
       link = link->NextSiblingElement("link")) {
    const auto found = links.find(link->Attribute("name"));
    if (found == links.end()) continue;
    while (TiXmlElement* old = link->FirstChildElement("inertial")) link->RemoveChild(old);
    const auto& [mass, p, I] = found->second;
    if (mass == 0 && I.isZero(0)) continue;
    TiXmlElement inertial("inertial"), origin("origin"), weight("mass"), inertia("inertia");
    origin.SetAttribute("xyz", fmt::format("{} {} {}", p.x(), p.y(), p.z()));
    weight.SetAttribute("value", fmt::format("{}", mass));
    for (const auto& [name, row, column] : {std::tuple{"ixx", 0, 0},
                                            {"iyy", 1, 1},
                                            {"izz", 2, 2},
                                            {"ixy", 0, 1},
                                            {"ixz", 0, 2},
                                            {"iyz", 1, 2}}) {
      inertia.SetAttribute(name, fmt::format("{}", I(row, column)));
    }
    for (const TiXmlElement* each : {&origin, &weight, &inertia}) inertial.InsertEndChild(*each);
    link->InsertEndChild(inertial);
  }
  TiXmlPrinter printer;
  printer.SetIndent(" ");
  document.Accept(&printer);
  return printer.CStr();
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

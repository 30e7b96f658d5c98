#include "robot/urdf_tree.h"

#include <fmt/format.h>
#include <tinyxml.h>

#include <algorithm>
#include <set>
#include <stdexcept>
#include <string_view>

#include "robot/model.h"

namespace tachless::robot {
namespace {

/// Refuses joints that close a chain.
class TreeCheck {
 public:
  explicit TreeCheck(const std::string& source) : source_(source) {}

  void add(const std::string& joint, const std::string& parent, const std::string& child) {
    const auto [above, fresh] = above_.emplace(child, Above{joint, parent});
    if (fresh) return;
    refuse_urdf(source_, fmt::format("link '{}' is the child of two joints, '{}' and '{}': closed "
                                     "chains are not supported; cut one",
                                     child, above->second.joint, joint));
  }

  /// Walks from every link towards the root, each link once.
  void finish() const {
    std::set<std::string> leads_to_root;
    for (const auto& [start, unused] : above_) {
      std::set<std::string> walked;
      for (auto at = above_.find(start); at != above_.end() && leads_to_root.count(at->first) == 0;
           at = above_.find(at->second.parent)) {
        if (walked.insert(at->first).second) continue;
        refuse_urdf(source_, fmt::format("joint '{}' hangs link '{}' on its own descendant; hang "
                                         "it on a link nearer the root",
                                         at->second.joint, at->first));
      }
      leads_to_root.merge(walked);
    }
  }

 private:
  struct Above {
    std::string joint, parent;
  };
  std::string source_;
  std::map<std::string, Above> above_;  ///< by child link
};

}  // namespace

void refuse_urdf(const std::string& source, const std::string& problem) {
  std::string line = source + ": " + problem;
  std::replace_if(
      line.begin(), line.end(), [](char c) { return c == '\n' || c == '\r' || c == '\t'; }, ' ');
  throw std::invalid_argument(line);
}

namespace {

TiXmlDocument parsed(const std::string& text, const std::string& source) {
  TiXmlDocument document;
  document.Parse(text.c_str(), nullptr, TIXML_ENCODING_UTF8);
  if (document.Error()) {
    std::string why = document.ErrorDesc();
    if (!why.empty() && why.back() == '.') why.pop_back();
    refuse_urdf(source, fmt::format("line {}: malformed XML: {}; correct the file's XML",
                                    document.ErrorRow(), why));
  }
  if (document.FirstChildElement("robot") == nullptr) {
    refuse_urdf(source, "no <robot> element; give a URDF file");
  }
  return document;
}

[[noreturn]] void refuse_xacro(const TiXmlBase& at, std::string_view what,
                               const std::string& source) {
  refuse_urdf(
      source,
      fmt::format("line {}: \"{}\" is for xacro; run `xacro {} > robot.urdf` and give robot.urdf",
                  at.Row(), what, source));
}

std::vector<std::string_view> read_children(std::string_view element) {
  if (element == "link") return {"inertial"};
  if (element == "inertial") return {"origin", "mass", "inertia"};
  if (element == "joint") {
    return {"origin", "parent", "child", "axis", "limit", "dynamics", "mimic"};
  }
  return {};
}

/// The attributes of `from` and those of its elements that are read, the first of each kind.
TiXmlElement mechanics_of(const TiXmlElement& from, const std::string& source) {
  TiXmlElement kept(from.ValueStr());
  for (const auto* a = from.FirstAttribute(); a != nullptr; a = a->Next()) {
    for (const char* mark : {"${", "$("}) {
      if (a->ValueStr().find(mark) != std::string::npos) refuse_xacro(from, a->ValueStr(), source);
    }
    kept.SetAttribute(a->Name(), a->ValueStr());
  }
  for (const auto* e = from.FirstChildElement(); e != nullptr; e = e->NextSiblingElement()) {
    if (e->ValueStr().starts_with("xacro:")) refuse_xacro(*e, "<" + e->ValueStr() + ">", source);
  }
  for (const std::string_view name : read_children(from.ValueStr())) {
    if (const auto* e = from.FirstChildElement(std::string(name))) {
      kept.InsertEndChild(mechanics_of(*e, source));
    }
  }
  return kept;
}

TiXmlElement robot_mechanics(const TiXmlDocument& document, const std::string& source) {
  const TiXmlElement& robot = *document.FirstChildElement("robot");
  TiXmlElement kept("robot");
  const char* name = robot.Attribute("name");
  kept.SetAttribute("name", name == nullptr ? "robot" : name);  // used nowhere
  for (const auto* e = robot.FirstChildElement(); e != nullptr; e = e->NextSiblingElement()) {
    const std::string& kind = e->ValueStr();
    if (kind.starts_with("xacro:")) refuse_xacro(*e, "<" + kind + ">", source);
    if (kind == "link" || kind == "joint") kept.InsertEndChild(mechanics_of(*e, source));
  }
  return kept;
}

std::string printed(const TiXmlElement& element) {
  TiXmlPrinter printer;
  printer.SetStreamPrinting();
  element.Accept(&printer);
  return printer.CStr();
}

/// Checks names and tree. @return the joints below each link, in the order of the file
std::map<std::string, std::vector<std::string>> checked_tree(const TiXmlElement& robot,
                                                             const std::string& source) {
  std::map<std::string, std::vector<std::string>> joints_below;
  TreeCheck tree(source);
  std::set<std::string> links, joints;
  for (const auto* e = robot.FirstChildElement(); e != nullptr; e = e->NextSiblingElement()) {
    const std::string& kind = e->ValueStr();
    const bool is_joint = kind == "joint";
    if (!is_joint && kind != "link") continue;
    const char* name = e->Attribute("name");
    if (name == nullptr || *name == '\0') {
      refuse_urdf(source,
                  fmt::format("line {}: a {} has no name; give it name=\"...\"", e->Row(), kind));
    }
    if (!(is_joint ? joints : links).insert(name).second) {
      refuse_urdf(source, fmt::format("line {}: {} '{}' is defined twice; rename one", e->Row(),
                                      kind, name));
    }
    if (!is_joint) continue;
    const TiXmlElement* parent = e->FirstChildElement("parent");
    const TiXmlElement* child = e->FirstChildElement("child");
    const char* parent_link = parent != nullptr ? parent->Attribute("link") : nullptr;
    const char* child_link = child != nullptr ? child->Attribute("link") : nullptr;
    // urdfdom says which joint lacks one.
    if (parent_link == nullptr || child_link == nullptr) continue;
    tree.add(name, parent_link, child_link);
    joints_below[parent_link].push_back(name);
  }
  tree.finish();
  return joints_below;
}

/// Turns locked joints of any type into fixed ones, where urdfdom would refuse the type.
/// @return whether the joint moves
bool settle_type(TiXmlElement& joint, const std::string& source,
                 const std::map<std::string, double>& locked) {
  const std::string name = joint.Attribute("name");
  const char* given = joint.Attribute("type");
  const std::string type = given == nullptr ? "" : given;
  if (type == "fixed") return false;
  const auto lock = locked.find(name);
  if (type == "revolute" || type == "continuous" || type == "prismatic") {
    return lock == locked.end();
  }
  const std::string problem = type.empty()
                                  ? fmt::format("joint '{}': has no type", name)
                                  : fmt::format("joint '{}': type {} is not supported", name, type);
  if (lock == locked.end()) {
    refuse_urdf(source, fmt::format("{}; use revolute, continuous, prismatic or fixed, or fix it "
                                    "in the scenario: robot.locked: {{{}: 0}}",
                                    problem, name));
  }
  if (lock->second != 0) {
    refuse_urdf(source,
                fmt::format("{}; it can be locked at 0 only, not at {}", problem, lock->second));
  }
  joint.SetAttribute("type", "fixed");
  return false;
}

/// What is not given, by what is then assumed: a file repeats itself from joint to joint.
using Assumed = std::map<std::string, std::vector<std::string>>;

/// Whether neither end is given, or all four are 0: what exporters write who know none.
bool range_missing(const TiXmlElement& limit) {
  const auto zero = [&](const char* name) {
    double value = 0;
    return limit.QueryDoubleAttribute(name, &value) == TIXML_SUCCESS && value == 0;
  };
  if (limit.Attribute("lower") == nullptr && limit.Attribute("upper") == nullptr) return true;
  return zero("lower") && zero("upper") && zero("effort") && zero("velocity");
}

/// Gives a joint the limits that urdfdom insists on; 0 means none.
void complete_limits(TiXmlElement& joint, bool moves, UrdfXml& xml, Assumed& assumed) {
  const std::string name = joint.Attribute("name");
  if (std::string_view(joint.Attribute("type")) == "fixed") return;
  const bool has_range = std::string_view(joint.Attribute("type")) != "continuous";
  if (joint.FirstChildElement("limit") == nullptr) {
    if (!has_range) return;
    joint.InsertEndChild(TiXmlElement("limit"));
  }
  TiXmlElement& limit = *joint.FirstChildElement("limit");
  const bool speaks = moves && joint.FirstChildElement("mimic") == nullptr;
  for (const char* what : {"effort", "velocity"}) {
    if (limit.Attribute(what) != nullptr) continue;
    limit.SetAttribute(what, "0");
    if (speaks) assumed[fmt::format("{} limit", what)].push_back(name);
  }
  if (!has_range || !range_missing(limit)) return;
  xml.joints_without_range.insert(name);
  if (speaks) assumed["range (lower, upper)"].push_back(name);
}

}  // namespace

std::string urdf_mechanics(const std::string& text, const std::string& source) {
  return printed(robot_mechanics(parsed(text, source), source));
}

UrdfXml read_urdf_xml(const std::string& text, const std::string& source,
                      const std::map<std::string, double>& locked) {
  const TiXmlDocument document = parsed(text, source);
  UrdfXml xml;
  TiXmlElement robot = robot_mechanics(document, source);
  xml.joints_below = checked_tree(*document.FirstChildElement("robot"), source);
  Assumed assumed;
  for (auto* e = robot.FirstChildElement("joint"); e; e = e->NextSiblingElement("joint")) {
    const bool moves = settle_type(*e, source, locked);
    complete_limits(*e, moves, xml, assumed);
  }
  xml.warnings.reserve(assumed.size());
  for (const auto& [what, joints] : assumed) {
    xml.warnings.push_back(fmt::format("{}: {} {}: no {} is given; none is assumed", source,
                                       joints.size() == 1 ? "joint" : "joints",
                                       fmt::join(joints, ", "), what));
  }
  xml.text = printed(robot);
  return xml;
}

}  // namespace tachless::robot

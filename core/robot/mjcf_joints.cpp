#include "robot/mjcf_joints.h"

#include <fmt/format.h>
#include <tinyxml.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <optional>
#include <sstream>
#include <string_view>
#include <utility>
#include <vector>

#include "base/text.h"
#include "robot/urdf_xml.h"

namespace tachless::robot {
namespace {

constexpr std::array<std::pair<const char*, double JointNumbers::*>, 3> attributes{
    {{"armature", &JointNumbers::rotor_inertia},
     {"damping", &JointNumbers::viscous_friction},
     {"frictionloss", &JointNumbers::coulomb_friction}}};

class MjcfReader {
 public:
  MjcfReader(const std::string& text, const std::string& source) : source_(source) {
    if (const std::string why = why_too_large(text); !why.empty()) refuse(why);
    document_.Parse(text.c_str(), nullptr, TIXML_ENCODING_UTF8);
    if (document_.Error()) refuse(fmt::format("malformed XML: {}", document_.ErrorDesc()));
    if (const int line = line_of_unread_markup(document_); line != 0) {
      refuse(fmt::format("line {}: malformed XML: a < without the name of an element", line));
    }
    const TiXmlElement* const model = document_.FirstChildElement("mujoco");
    if (model == nullptr) {
      refuse(fmt::format("no <mujoco> element: it is {}; allowed: an MJCF, or a YAML map",
                         xml_kind(text, source)));
    }
    check_elements(*model);
    classes_["main"] = {};
    check_children(*model);
    for (const auto* e = model->FirstChildElement("default"); e;
         e = e->NextSiblingElement("default")) {
      read_top_class(*e);
    }
    for (const auto* e = model->FirstChildElement("worldbody"); e;
         e = e->NextSiblingElement("worldbody")) {
      read_body(*e, "main");
    }
  }

  std::map<std::string, JointNumbers> joints() { return std::move(joints_); }

 private:
  [[noreturn]] void refuse(const std::string& problem) const { refuse_urdf(source_, problem); }

  /// Refuses what would change the joints' numbers and is not read: files that are included,
  /// armatures of actuators, two joints in one class.
  void check_elements(const TiXmlElement& of) const {
    int joints = 0;
    for (const auto* e = of.FirstChildElement(); e; e = e->NextSiblingElement()) {
      const std::string& name = e->ValueStr();
      if (name == "include") {
        const char* const file = e->Attribute("file");
        refuse(
            fmt::format("line {}: it includes {}, which is not followed; give that file, or one "
                        "with its content in place",
                        e->Row(), file == nullptr ? "a file" : file));
      }
      if (name == "joint" && of.ValueStr() == "default" && ++joints > 1) {
        refuse(fmt::format("line {}: <default> has two <joint>; remove one", e->Row()));
      }
      if (name != "joint" && e->Attribute("armature") != nullptr) {
        refuse(
            fmt::format("line {}: the armature of <{}> is not read; add gear^2 times it to the "
                        "armature of its joint",
                        e->Row(), name));
      }
      check_elements(*e);
    }
  }

  /// Returns the children that MuJoCo has of an element that is read.
  static std::string_view known_children(std::string_view element) {
    if (element == "mujoco") {
      return " compiler option size visual statistic default custom extension asset worldbody "
             "deformable contact equality tendon actuator sensor keyframe ";
    }
    if (element == "default") {
      return " joint default mesh material geom site camera light pair equality tendon general "
             "motor "
             "position velocity intvelocity damper cylinder muscle adhesion dcmotor ";
    }
    if (element == "worldbody") {
      return " body frame geom site camera light composite flexcomp plugin attach ";
    }
    return " body frame joint freejoint inertial geom site camera light composite flexcomp plugin "
           "attach ";
  }

  /// Returns whether joints, bodies or defaults are in an element.
  static bool holds_joints(const TiXmlElement& e) {
    const std::string& name = e.ValueStr();
    if (name == "joint" || name == "body" || name == "default" || name == "worldbody") return true;
    for (const auto* child = e.FirstChildElement(); child; child = child->NextSiblingElement()) {
      if (holds_joints(*child)) return true;
    }
    return false;
  }

  /// Refuses children with joints that are not read, misspelt names of children, text, and
  /// attributes of joints in another element.
  void check_children(const TiXmlElement& of) const {
    const std::string& element = of.ValueStr();
    const std::string_view known = known_children(element);
    for (const auto* node = of.FirstChild(); node != nullptr; node = node->NextSibling()) {
      // A mark alone, such as a second >, hides no element.
      const bool has_words = std::ranges::any_of(
          node->ValueStr(), [](unsigned char c) { return std::isalpha(c) != 0; });
      if (node->ToText() != nullptr && has_words) {
        refuse(fmt::format("line {}: text in <{}>; remove it", node->Row(), element));
      }
      const TiXmlElement* const e = node->ToElement();
      if (e == nullptr || known.find(" " + e->ValueStr() + " ") != std::string_view::npos) continue;
      const auto near = base::nearest(e->ValueStr(), base::split(known, ' '));
      if (!near && !holds_joints(*e)) continue;
      refuse(fmt::format(
          "line {}: <{:.40}> in <{}> is not read; {}", e->Row(), e->ValueStr(), element,
          near ? "the nearest known name is " + *near
               : "put joints into a <body>, their numbers for a class into a <default>"));
    }
    for (const auto* a = of.FirstAttribute(); a != nullptr; a = a->Next()) {
      const std::string name = a->Name();
      const bool class_here = name == (element == "default" ? "class" : "childclass") &&
                              element != "mujoco" && element != "worldbody";
      if (class_here) continue;
      static const std::vector<std::string_view> of_joints{"armature", "damping", "frictionloss",
                                                           "class", "childclass"};
      // "class" is short and near to other names.
      const auto near = base::nearest(name, of_joints);
      if (!near || (element != "default" && *near == "class" && name != "class")) continue;
      refuse(fmt::format("line {}: <{}> has the attribute {:.40}, which is not read there; {}",
                         of.Row(), element, name, "the nearest known name is " + *near));
    }
  }

  /// Refuses an attribute that MuJoCo does not have in a joint.
  void check_attributes(const TiXmlElement& joint) const {
    static const std::vector<std::string_view> known{"name",
                                                     "class",
                                                     "type",
                                                     "group",
                                                     "pos",
                                                     "axis",
                                                     "springdamper",
                                                     "limited",
                                                     "actuatorfrclimited",
                                                     "actuatorgravcomp",
                                                     "solreflimit",
                                                     "solimplimit",
                                                     "solreffriction",
                                                     "solimpfriction",
                                                     "stiffness",
                                                     "range",
                                                     "actuatorfrcrange",
                                                     "margin",
                                                     "ref",
                                                     "springref",
                                                     "armature",
                                                     "damping",
                                                     "frictionloss",
                                                     "user"};
    for (const auto* a = joint.FirstAttribute(); a != nullptr; a = a->Next()) {
      const std::string name = a->Name();
      if (std::ranges::find(known, name) != known.end()) continue;
      const auto near = base::nearest(name, known);
      refuse(fmt::format("line {}: <joint> has the attribute {:.40}; {}", joint.Row(), name,
                         near ? "the nearest known name is " + *near
                              : "allowed: armature, damping, frictionloss and MuJoCo's others"));
    }
  }

  /// The number of an attribute. MuJoCo takes coefficients of higher powers behind it: they have to
  /// be 0.
  double number(const TiXmlElement& joint, const char* name, std::string_view written) const {
    std::istringstream words{std::string(written)};
    std::vector<double> found;
    bool valid = true;
    for (std::string word; words >> word;) {
      const std::optional<double> value = base::number_in(word);
      valid = valid && value && std::isfinite(*value) && *value >= 0;
      found.push_back(value.value_or(0));
    }
    if (!valid || found.empty()) {
      refuse(fmt::format("line {}: {}=\"{:.40}\"; allowed: a finite number from 0 on", joint.Row(),
                         name, written));
    }
    constexpr std::size_t most = 3;  // coefficients of MuJoCo's damping
    if (found.size() > most) {
      refuse(
          fmt::format("line {}: {}=\"{:.40}\"; allowed: one number, or {} with 0 behind the first",
                      joint.Row(), name, written, most));
    }
    if (std::any_of(found.begin() + 1, found.end(), [](double x) { return x != 0; })) {
      refuse(
          fmt::format("line {}: {}=\"{:.40}\": coefficients of higher powers; allowed: 0 behind "
                      "the first number",
                      joint.Row(), name, written));
    }
    return found.front();
  }

  /// The numbers that an element gives itself, over those that it starts from.
  JointNumbers numbers(const TiXmlElement& joint, JointNumbers start) const {
    check_attributes(joint);
    for (const auto& [name, member] : attributes) {
      const char* const text = joint.Attribute(name);
      if (text != nullptr) start.*member = number(joint, name, text);
    }
    return start;
  }

  /// Reads defaults at the top, whose class, whatever its name, is that of elements without one.
  void read_top_class(const TiXmlElement& element) {
    const char* const given = element.Attribute("class");
    const std::string name = given == nullptr ? "main" : given;
    if (!top_class_.empty() && name != top_class_) {
      refuse(
          fmt::format("line {}: class \"{:.40}\" beside \"{:.40}\" at the top; put it into the "
                      "other <default>",
                      element.Row(), name, top_class_));
    }
    top_class_ = name;
    read_class(element, name, classes_["main"]);
    classes_["main"] = classes_[name];
  }

  /// Reads a class. Its numbers are those of its joint, or else of the class around it.
  void read_class(const TiXmlElement& element, const std::string& name, JointNumbers numbers_here) {
    check_children(element);
    if (const auto* joint = element.FirstChildElement("joint")) {
      numbers_here = numbers(*joint, numbers_here);
    }
    classes_[name] = numbers_here;
    for (const auto* e = element.FirstChildElement("default"); e;
         e = e->NextSiblingElement("default")) {
      const char* const inner = e->Attribute("class");
      if (inner == nullptr) {
        refuse(fmt::format("line {}: a <default> in another has no class; give it class=\"...\"",
                           e->Row()));
      }
      if (classes_.contains(inner)) {
        refuse(fmt::format("line {}: two classes \"{:.40}\"; rename one", e->Row(), inner));
      }
      read_class(*e, inner, numbers_here);
    }
  }

  void read_body(const TiXmlElement& body, std::string around) {
    check_children(body);
    if (const char* name = body.Attribute("childclass")) around = name;
    for (const auto* e = body.FirstChildElement(); e; e = e->NextSiblingElement()) {
      if (e->ValueStr() == "body" || e->ValueStr() == "frame") read_body(*e, around);
      const char* const name = e->Attribute("name");
      if (e->ValueStr() != "joint" || name == nullptr) continue;
      const char* const own = e->Attribute("class");
      const auto of_class = classes_.find(own == nullptr ? around : own);
      if (of_class == classes_.end()) {
        refuse(fmt::format("line {}: class \"{:.40}\" is not among its defaults", e->Row(),
                           own == nullptr ? around : own));
      }
      if (!joints_.emplace(name, numbers(*e, of_class->second)).second) {
        refuse(fmt::format("line {}: two joints \"{:.40}\"; rename one", e->Row(), name));
      }
    }
  }

  const std::string& source_;
  TiXmlDocument document_;
  std::map<std::string, JointNumbers> classes_, joints_;
  std::string top_class_;  ///< name of the class at the top; empty: there is none
};

}  // namespace

std::map<std::string, JointNumbers> read_mjcf_joints(const std::string& text,
                                                     const std::string& source) {
  return MjcfReader(text, source).joints();
}

}  // namespace tachless::robot

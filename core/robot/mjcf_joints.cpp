#include "robot/mjcf_joints.h"

#include <fmt/format.h>
#include <tinyxml.h>

#include <array>
#include <charconv>
#include <cmath>
#include <cstring>
#include <string_view>
#include <utility>

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
    const TiXmlElement* const model = document_.FirstChildElement("mujoco");
    if (model == nullptr) {
      refuse(fmt::format("no <mujoco> element: it is {}; allowed: an MJCF, or a YAML map",
                         xml_kind(text, source)));
    }
    classes_["main"] = {};
    for (const auto* e = model->FirstChildElement("default"); e;
         e = e->NextSiblingElement("default")) {
      read_class(*e, classes_["main"]);
      // Whatever its name, the class at the top is that of elements without one.
      if (const char* name = e->Attribute("class")) classes_["main"] = classes_[name];
    }
    for (const auto* e = model->FirstChildElement("worldbody"); e;
         e = e->NextSiblingElement("worldbody")) {
      read_body(*e, "main");
    }
  }

  std::map<std::string, JointNumbers> joints() { return std::move(joints_); }

 private:
  [[noreturn]] void refuse(const std::string& problem) const { refuse_urdf(source_, problem); }

  /// The numbers that an element gives itself, over those that it starts from.
  JointNumbers numbers(const TiXmlElement& joint, JointNumbers start) const {
    for (const auto& [name, member] : attributes) {
      const char* const text = joint.Attribute(name);
      if (text == nullptr) continue;
      const std::string_view written = text;
      double value = 0;
      const auto [end, error] = std::from_chars(text, text + written.size(), value);
      if (error != std::errc{} || end != text + written.size() || !std::isfinite(value) ||
          value < 0) {
        refuse(fmt::format("line {}: {}=\"{:.40}\"; allowed: a finite number from 0 on",
                           joint.Row(), name, written));
      }
      start.*member = value;
    }
    return start;
  }

  /// A class with its joint's defaults, which are those of the class around it but for its own.
  void read_class(const TiXmlElement& element, JointNumbers outer) {
    const char* const name = element.Attribute("class");
    if (const auto* joint = element.FirstChildElement("joint")) outer = numbers(*joint, outer);
    classes_[name == nullptr ? "main" : name] = outer;
    for (const auto* e = element.FirstChildElement("default"); e;
         e = e->NextSiblingElement("default")) {
      read_class(*e, outer);
    }
  }

  void read_body(const TiXmlElement& body, std::string around) {
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
      joints_[name] = numbers(*e, of_class->second);
    }
  }

  const std::string& source_;
  TiXmlDocument document_;
  std::map<std::string, JointNumbers> classes_, joints_;
};

}  // namespace

std::map<std::string, JointNumbers> read_mjcf_joints(const std::string& text,
                                                     const std::string& source) {
  return MjcfReader(text, source).joints();
}

}  // namespace tachless::robot

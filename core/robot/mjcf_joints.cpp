#include "robot/mjcf_joints.h"

#include "robot/mjcf_document.h"
#include "robot/mjcf_drives.h"

namespace tachless::robot {
namespace {

using Joints = std::map<std::string, JointNumbers>;

/// Adds the named joints of a body and of the bodies in it.
/// @param around class of joints without one
void add_joints(const MjcfDocument& document, const XmlElement& body, std::string around,
                Joints& joints) {
  around = document.attributes(body, "main").text("childclass", around);
  for (const XmlElement* each : document.children(body)) {
    const std::string& kind = name_of(*each);
    if (kind == "body" || kind == "frame") add_joints(document, *each, around, joints);
    if (kind != "joint") continue;
    const MjcfAttributes joint = document.attributes(*each, around);
    if (!joint.has("name")) continue;
    const double unit = joint.text("type", "hinge") == "slide" ? 1 : document.angle_unit();
    const JointNumbers numbers{joint.coefficient("armature"), joint.coefficient("damping"),
                               joint.coefficient("frictionloss"), unit * joint.number("ref", 0)};
    if (!joints.emplace(joint.text("name"), numbers).second) {
      joint.refuse("there are two; rename one");
    }
  }
}

}  // namespace

Joints read_mjcf_joints(const std::string& text, const std::string& source,
                        const IncludedText& included) {
  const MjcfDocument document(text, source, included);
  for (const XmlElement* each : document.in_sections("actuator")) {
    (void)actuator_attributes(document, *each);
  }
  Joints joints;
  for (const XmlElement* each : document.sections("worldbody")) {
    add_joints(document, *each, "main", joints);
  }
  return joints;
}

}  // namespace tachless::robot

#include "robot/mjcf_drives.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/text.h"

namespace tachless::robot {

MjcfAttributes actuator_attributes(const MjcfDocument& document, const XmlElement& actuator) {
  MjcfAttributes read = document.attributes(actuator, "main", "actuator");
  for (const char* name : {"armature", "damping"}) {
    const auto given = read.numbers(name, 1, 3);
    if (std::ranges::all_of(given, [](double x) { return x == 0; })) continue;
    read.refuse(fmt::format("the {} of <{}> is not read; add gear^2 times it to that of its joint",
                            name, name_of(actuator)));
  }
  return read;
}

MjcfDrives::MjcfDrives(const MjcfDocument& document) : document_(document) {
  for (const XmlElement* each : document.in_sections("tendon")) read_tendon(*each);
  for (const XmlElement* each : document.in_sections("equality")) read_equality(*each);
  for (const XmlElement* each : document.in_sections("actuator")) read_actuator(*each);
}

void MjcfDrives::warn(const XmlElement& at, const std::string& problem) {
  warnings_.push_back(base::one_line(document_.where(at) + ": " + problem));
}

void MjcfDrives::read_tendon(const XmlElement& tendon) {
  if (name_of(tendon) == "spatial") {
    document_.refuse(tendon, "<spatial> is not read; remove the tendon");
  }
  if (name_of(tendon) != "fixed") {
    document_.refuse(
        tendon, fmt::format("<{:.60}> in <tendon> is not read; allowed: fixed", name_of(tendon)));
  }
  const MjcfAttributes a = document_.attributes(tendon, "main", "tendon/fixed");
  for (const char* name : {"stiffness", "damping", "frictionloss", "armature"}) {
    const auto given = a.numbers(name, 1, 3);
    if (std::ranges::all_of(given, [](double x) { return x == 0; })) continue;
    a.refuse(fmt::format("{}=\"{}\" of a tendon is not read; remove it", name, a.text(name)));
  }
  if (a.range("range", "limited")) a.refuse("a range of a tendon is not read; remove it");
}

void MjcfDrives::read_equality(const XmlElement& equality) {
  const char* const active = equality.Attribute("active");
  if (active != nullptr && std::string_view(active) == "false") return;
  if (name_of(equality) != "joint") {
    document_.refuse(equality, fmt::format("<{:.60}> in <equality> is not read; allowed: joint; "
                                           "remove it, or give it active=\"false\"",
                                           name_of(equality)));
  }
  const MjcfAttributes a = document_.attributes(equality, "main", "equality/joint");
  if (!a.flag("active", true)) return;
  const std::string joint = a.text("joint1"), other = a.text("joint2");
  if (joint.empty()) a.refuse("it has no joint1; add one");
  if (other.empty()) {
    a.refuse(
        fmt::format("joint1 alone is not read; hold it in the scenario: robot.locked: "
                    "{{{:.60}: ...}}",
                    joint));
  }
  std::vector<double> c = a.numbers("polycoef", 1, 5);
  if (c.empty()) c = {0, 1};
  c.resize(5);
  if (c[2] != 0 || c[3] != 0 || c[4] != 0) {
    a.refuse(
        fmt::format("polycoef=\"{}\"; allowed: 0 for the powers from 2 on", a.text("polycoef")));
  }
  if (!mimics_.emplace(joint, MjcfMimic{other, c[1], c[0], &equality}).second) {
    a.refuse(fmt::format("joint '{:.60}' has two; remove one", joint));
  }
  named_.emplace_back(joint, &equality);
  named_.emplace_back(other, &equality);
}

std::optional<double> MjcfDrives::smaller_side(const MjcfAttributes& attributes,
                                               const std::string& range,
                                               const std::string& limited) {
  const auto ends = attributes.range(range, limited);
  if (!ends) return std::nullopt;
  if (ends->first >= 0 || ends->second <= 0) {
    warn(attributes.element(), fmt::format("{}=\"{}\" pushes to one side; it is no effort limit",
                                           range, attributes.text(range)));
    return std::nullopt;
  }
  if (ends->first != -ends->second) {
    warn(attributes.element(), fmt::format("{}=\"{}\": the smaller side is the effort limit", range,
                                           attributes.text(range)));
  }
  return std::min(-ends->first, ends->second);
}

std::optional<double> MjcfDrives::force_of(const MjcfAttributes& actuator) {
  if (const auto force = smaller_side(actuator, "forcerange", "forcelimited")) return force;
  const std::string& kind = name_of(actuator.element());
  const bool follows = actuator.text("gaintype", "fixed") == "fixed" &&
                       actuator.text("biastype", "none") == "none" &&
                       actuator.text("dyntype", "none") == "none";
  if (kind != "motor" && (kind != "general" || !follows)) return std::nullopt;
  const auto control = smaller_side(actuator, "ctrlrange", "ctrllimited");
  const auto gain = actuator.numbers("gainprm", 1, 10);
  if (!control || kind == "motor" || gain.empty()) return control;
  return *control * std::abs(gain.front());
}

void MjcfDrives::read_actuator(const XmlElement& element) {
  const MjcfAttributes actuator = actuator_attributes(document_, element);
  const std::string joint = actuator.text("joint", actuator.text("jointinparent"));
  if (joint.empty()) {
    warn(element, fmt::format("<{}> '{}' acts on no joint; its force limit is not read",
                              name_of(element), actuator.text("name")));
    return;
  }
  named_.emplace_back(joint, &element);
  const auto force = force_of(actuator);
  if (!force) return;
  const auto gear = actuator.numbers("gear", 1, 6);
  const double effort = *force * (gear.empty() ? 1 : std::abs(gear.front()));
  const auto [found, fresh] = efforts_.emplace(joint, effort);
  if (fresh) return;
  found->second = std::max(found->second, effort);
  warn(element, fmt::format("joint '{}' has several actuators; the strongest limits it", joint));
}

std::optional<double> MjcfDrives::effort_of(const MjcfAttributes& joint,
                                            const std::string& name) const {
  const auto found = efforts_.find(name);
  const auto range = joint.range("actuatorfrcrange", "actuatorfrclimited");
  if (!range) return found == efforts_.end() ? std::nullopt : std::optional(found->second);
  if (range->first >= 0 || range->second <= 0) {
    joint.refuse(fmt::format("actuatorfrcrange=\"{}\"; allowed: one end below 0, one above",
                             joint.text("actuatorfrcrange")));
  }
  const double own = std::min(-range->first, range->second);
  return found == efforts_.end() ? own : std::min(own, found->second);
}

void MjcfDrives::require_joints(const std::set<std::string>& joints) const {
  for (const auto& [name, element] : named_) {
    if (joints.contains(name)) continue;
    const auto near = base::nearest(name, joints);
    document_.refuse(
        *element,
        fmt::format("<{}> names joint '{:.60}', which is not in the robot; {}", name_of(*element),
                    name,
                    near ? "the nearest is " + *near : "its joints are " + base::joined(joints)));
  }
}

}  // namespace tachless::robot

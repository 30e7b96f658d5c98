#include "robot/mjcf_servos.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <optional>
#include <utility>

#include "base/text.h"
#include "robot/mjcf_document.h"
#include "robot/mjcf_drives.h"
#include "robot/mjcf_joints.h"

namespace tachless::robot {
namespace {

constexpr std::array<std::string_view, 4> integrators{"Euler", "RK4", "implicit", "implicitfast"};

double entry(const std::vector<double>& numbers, std::size_t i) {
  return i < numbers.size() ? numbers[i] : 0;
}

/// Returns the gains of an actuator on its own side of the gear. Its class may have given them as
/// kp and kv, or as gainprm and biasprm. Returns nothing where they are not constant.
std::optional<MjcfServo> gains_of(const MjcfAttributes& actuator) {
  const std::string& kind = name_of(actuator.element());
  const bool position = kind == "position" || kind == "intvelocity";
  const auto gain = actuator.numbers("gainprm", 1, 10), bias = actuator.numbers("biasprm", 1, 10);
  MjcfServo servo;
  if (kind == "velocity") {
    servo.kv = actuator.number("kv", gain.empty() ? 1 : gain.front());
  } else if (position) {
    servo.kp = actuator.number("kp", gain.empty() ? 1 : gain.front());
    servo.kv = actuator.number("kv", 0 - entry(bias, 2));
    servo.damping_ratio = actuator.number("dampratio", 0);
  } else if (kind == "general") {
    const bool by_class = bias.empty() && actuator.has("kp");
    const std::string of_bias = actuator.text("biastype", by_class ? "affine" : "none");
    if (actuator.text("gaintype", "fixed") != "fixed") return std::nullopt;
    if (of_bias != "none" && of_bias != "affine") return std::nullopt;
    if (of_bias == "affine") {
      servo.kp = by_class ? actuator.number("kp", 0) : 0 - entry(bias, 1);
      servo.kv = by_class ? actuator.number("kv", 0) : 0 - entry(bias, 2);
    }
  } else if (kind != "motor") {
    return std::nullopt;
  }
  for (const auto& [name, value] :
       {std::pair{"kp", servo.kp}, {"kv", servo.kv}, {"dampratio", servo.damping_ratio}}) {
    if (value < 0) actuator.refuse(fmt::format("{} is {:g}; allowed: from 0 on", name, value));
  }
  if (servo.damping_ratio > 0) servo.kv = 0;
  return servo;
}

class ServoReader {
 public:
  ServoReader(const std::string& text, const std::string& source, const IncludedText& included)
      : document_(text, source, included) {
    for (const auto& [joint, numbers] : read_mjcf_joints(text, source, included)) {
      read_.reference[joint] = numbers.reference;
    }
  }

  MjcfServos servos() {
    for (const XmlElement* each : document_.sections("option")) read_option(*each);
    for (const XmlElement* each : document_.in_sections("actuator")) read_actuator(*each);
    return std::move(read_);
  }

 private:
  void warn(const XmlElement& at, const std::string& problem) {
    read_.warnings.push_back(base::one_line(document_.where(at) + ": " + problem));
  }

  void read_option(const XmlElement& element) {
    const MjcfAttributes option = document_.own_attributes(element);
    read_.integrator = option.text("integrator", read_.integrator);
    if (std::ranges::find(integrators, read_.integrator) == integrators.end()) {
      option.refuse(fmt::format("integrator=\"{:.60}\"; allowed: {}", read_.integrator,
                                base::joined(integrators)));
    }
    read_.step_s = option.number("timestep", read_.step_s);
    if (read_.step_s <= 0) {
      option.refuse(fmt::format("timestep=\"{:g}\"; allowed: above 0", read_.step_s));
    }
    for (const XmlElement* flag : document_.children(element)) {
      if (name_of(*flag) != "flag") continue;
      const std::string given = document_.own_attributes(*flag).text("eulerdamp", "enable");
      read_.implicit_joint_damping = given == "enable";
    }
  }

  void read_actuator(const XmlElement& element) {
    const MjcfAttributes actuator = actuator_attributes(document_, element);
    const std::string kind = name_of(element), name = actuator.text("name");
    const std::string joint = actuator.text("joint", actuator.text("jointinparent"));
    if (joint.empty()) {
      return warn(element, fmt::format("<{}> '{}' acts on no joint; it is left out", kind, name));
    }
    std::optional<MjcfServo> servo = gains_of(actuator);
    if (!servo) {
      return warn(element,
                  fmt::format("<{}> '{}' has no constant kp and kv; it is left out", kind, name));
    }
    if (servo->kp == 0 && servo->kv == 0) return;
    const auto gear = actuator.numbers("gear", 1, 6);
    const double ratio = gear.empty() ? 1 : gear.front();
    servo->kp *= ratio * ratio;
    servo->kv *= ratio * ratio;
    servo->name = name;
    servo->joint = joint;
    read_.servos.push_back(*servo);
  }

  MjcfDocument document_;
  MjcfServos read_;
};

}  // namespace

MjcfServos read_mjcf_servos(const std::string& text, const std::string& source,
                            const IncludedText& included) {
  return ServoReader(text, source, included).servos();
}

}  // namespace tachless::robot

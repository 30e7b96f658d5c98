#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "base/text.h"
#include "commission/commission.h"

namespace tachless::commission {
namespace {

constexpr const char* undetermined = "not determined";

template <class Value>
nlohmann::ordered_json json_of(const std::optional<Value>& value) {
  return value ? nlohmann::ordered_json(*value) : nlohmann::ordered_json(nullptr);
}

std::string says(const std::optional<bool>& told, const char* yes, const char* no,
                 const char* unknown) {
  if (!told) return unknown;
  return *told ? yes : no;
}

std::string unsent_text(const Commissioned& found) {
  if (!found.unsent) return "was not determined";
  switch (*found.unsent) {
    case Unsent::held:
      return "is the torque before";
    case Unsent::zeroed:
      return "is none";
    case Unsent::ends_the_run:
      break;
  }
  return "ended the run: " + found.unsent_text;
}

}  // namespace

std::string text(const Commissioned& found, const std::string& name) {
  std::string turning, assumed;
  for (const Commissioned::Joint& joint : found.joints) {
    if (joint.turns.value_or(false)) turning += joint.name + " turns against the URDF. ";
    if (joint.assumed_rotor > 0) {
      assumed +=
          fmt::format("{}{} {:.3g}", assumed.empty() ? "" : ", ", joint.name, joint.assumed_rotor);
    }
  }
  std::string text = fmt::format(
      "{}: {}{} {} {} Commands missed: {}. Trials repeated: {}. The arm's torque where none is "
      "sent {}. The clock is "
      "the "
      "{}. {:.3g} s of motion.\n\n",
      name, turning,
      says(found.adds_gravity, "The arm adds gravity itself.", "The arm does not add gravity.",
           "It was not determined whether the arm adds gravity."),
      says(found.adds_friction, "It adds friction.", "It does not add friction.",
           "It was not determined whether it adds friction."),
      found.delay
          ? fmt::format("Delay from reading to torque in ticks: {}, +- {:.2g} between joints.",
                        *found.delay, found.delay_spread / 2)
          : fmt::format("The delay was not determined: joints differ by {:.2g} ticks.",
                        found.delay_spread),
      found.missed, found.repeated, unsent_text(found), found.arm_is_clock ? "arm" : "computer",
      found.seconds);
  if (!assumed.empty()) {
    text += "The scenario states no rotors; the trials assumed inertias of " + assumed + ".\n\n";
  }
  std::vector<std::vector<std::string>> rows = {
      {"joint", "turns", "torque scale", "viscous", "dry", "noise", ""}};
  for (const Commissioned::Joint& joint : found.joints) {
    rows.push_back({joint.name, says(joint.turns, "against", "as stated", undetermined),
                    joint.scale ? fmt::format("{:.3f}", *joint.scale) : undetermined,
                    fmt::format("{:.3g}", joint.viscous), fmt::format("{:.3g}", joint.dry),
                    fmt::format("{:.2g}", joint.noise), joint.unit});
  }
  return text + base::table(rows, "llrrrrl");
}

void to_json(nlohmann::ordered_json& json, const Commissioned& found) {
  json = {{"adds_gravity", json_of(found.adds_gravity)},
          {"adds_friction", json_of(found.adds_friction)},
          {"delay_ticks", json_of(found.delay)},
          {"delay_spread_ticks", found.delay_spread},
          {"missed_commands", found.missed},
          {"repeated_trials", found.repeated},
          {"unsent_torque", found.unsent ? nlohmann::ordered_json(base::name_of(*found.unsent))
                                         : nlohmann::ordered_json(nullptr)},
          {"clock", found.arm_is_clock ? "arm" : "computer"},
          {"arm_time_s", found.seconds},
          {"joints", nlohmann::ordered_json::array()},
          {"misfits", found.misfits},
          {"overrides", found.overrides}};
  for (const Commissioned::Joint& joint : found.joints) {
    json["joints"].push_back({{"name", joint.name},
                              {"answers", json_of(joint.answers)},
                              {"turns_against_urdf", json_of(joint.turns)},
                              {"torque_scale", json_of(joint.scale)},
                              {"viscous_friction", joint.viscous},
                              {"dry_friction", joint.dry},
                              {"delay_ticks", json_of(joint.delay)},
                              {"assumed_rotor_inertia", joint.assumed_rotor},
                              {"torque_noise", joint.noise}});
  }
}

}  // namespace tachless::commission

#include "cli/design_text.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>

#include "base/json_text.h"
#include "base/schema.h"
#include "base/text.h"
#include "certify/certify.h"
#include "design/adaptation.h"
#include "design/maker_stiffness.h"
#include "robot/model.h"

namespace tachless::cli {
namespace {

using base::json_list;
using design::Candidate;
using design::Structure;

/// Returns one number of each joint, a column for each candidate that has gains.
struct Quantity {
  std::string name;
  std::function<Eigen::VectorXd(const certify::Prediction&)> of;
};

std::vector<Quantity> quantities(const certify::Prediction& loop) {
  std::vector<Quantity> all = {
      {"stiffness", [](const certify::Prediction& p) -> Eigen::VectorXd { return p.stiffness; }}};
  if (loop.rest_error.size() > 0 && loop.rest_error.any()) {
    all.push_back(
        {"F_c/kp", [](const certify::Prediction& p) -> Eigen::VectorXd { return p.rest_error; }});
  }
  if (loop.count_Nm) {
    all.push_back({"torque/count", [](const certify::Prediction& p) -> Eigen::VectorXd {
                     return p.count_Nm.value_or(Eigen::VectorXd());
                   }});
  }
  return all;
}

/// Returns a table with a row for each joint.
std::string joints_text(const std::vector<Candidate>& candidates, const robot::Model& model) {
  std::vector<const Candidate*> found;
  for (const Candidate& each : candidates) {
    if (each.design) found.push_back(&each);
  }
  const certify::Prediction& first = found.front()->design->loop;
  const std::optional<design::MakerStiffness> maker = design::maker_stiffness(model);
  std::vector<std::vector<std::string>> rows(static_cast<std::size_t>(model.num_joints) + 1);
  rows[0].emplace_back("joint");
  for (std::size_t j = 1; j < rows.size(); ++j) rows[j].push_back(model.joint_names[j - 1]);
  const auto column = [&](const std::string& head, const Eigen::VectorXd& values) {
    rows[0].push_back(head);
    for (std::size_t j = 1; j < rows.size(); ++j) {
      const auto i = static_cast<Eigen::Index>(j - 1);
      rows[j].push_back(i < values.size() && values[i] != 0 ? fmt::format("{:.3g}", values[i])
                                                            : "-");
    }
  };
  for (const Quantity& quantity : quantities(first)) {
    for (const Candidate* const each : found) {
      column(fmt::format("{} {}", quantity.name, base::name_of(each->structure)),
             quantity.of(each->design->loop));
    }
    if (maker && quantity.name == "stiffness") column(maker->arm, maker->N_m_per_rad);
  }
  std::string text = base::table(rows, "lr");
  text += fmt::format("  stiffness in {}, F_c/kp in rad, torque of an encoder count in {}\n",
                      first.stiffness_unit, first.torque_unit);
  if (maker) text += fmt::format("  {}: {}\n", maker->arm, maker->source);
  return text;
}

}  // namespace

std::string design_text(const design::Design& design, const scenario::Scenario& scenario) {
  std::string text = fmt::format(
      "{}: gains of {} at h = {}, delay {}\n", scenario.name, scenario.controller.law_text(),
      base::period_text(scenario.loop.period_s), scenario.loop.command_delay);
  for (const std::string& gain : design::overrides_of(design)) {
    text += fmt::format("  --set '{}'\n", gain);
  }
  const auto line = [&](const std::string& what) { text += "  " + what + "\n"; };
  const certify::Prediction& loop = design.loop;
  line((design::adapts(scenario) ? "with constant estimates: " : "") + certify::text(loop));
  line(fmt::format("settling of an error of one joint alone: {} the slowest, {} the mean",
                   certify::settling_text(loop.modes.settling_s),
                   certify::settling_text(loop.modes.settling_mean_s)));
  line(fmt::format("margins: {}; modulus {} at q = {}", certify::margins_text(*loop.margins),
                   certify::modulus_text(*loop.margins), certify::list_text(loop.margin_q)));
  line(fmt::format(
      "least modulus margin found in the joints' range: {:.2g} (asked: {:.2g}) at q = {}",
      design.modulus_in_range, design.asked_in_range, certify::list_text(design.range_q)));
  if (design.uncertain_modulus) {
    line(fmt::format("least modulus margin found with an uncertain plant: {:.2g} ({}) at q = {}",
                     *design.uncertain_modulus, design.uncertain_plant,
                     certify::list_text(design.uncertain_q)));
  }
  line(fmt::format("stiffness {} {}", certify::list_text(loop.stiffness), loop.stiffness_unit));
  if (const std::string held = certify::friction_text(loop); !held.empty()) line(held);
  if (loop.count_Nm) {
    line(fmt::format("torque of one encoder count {} {}", certify::list_text(*loop.count_Nm),
                     loop.torque_unit));
  }
  for (const std::string& each : design.binds) line("limited by " + each);
  return text;
}

nlohmann::ordered_json design_json(const design::Design& design,
                                   const scenario::Scenario& scenario) {
  nlohmann::ordered_json json = {{"scenario", scenario.name},
                                 {"law", scenario.controller.law_text()}};
  for (const auto& [gain, values] : design.gains) json["gains"][gain] = json_list(values);
  json["overrides"] = design::overrides_of(design);
  json["sampled"] = to_json(design.loop);
  json["settling_mean_s"] = design.loop.modes.settling_mean_s;
  json["stiffness"] = json_list(design.loop.stiffness);
  json["modulus_in_range"] = design.modulus_in_range;
  json["range_q"] = json_list(design.range_q);
  if (design.uncertain_modulus) {
    json["uncertain"] = {{"modulus", *design.uncertain_modulus},
                         {"q", json_list(design.uncertain_q)},
                         {"plant", design.uncertain_plant}};
  }
  json["limited_by"] = design.binds;
  json["warnings"] = design.warnings;
  json["objections"] = design.objections;
  json["reached"] = !design.missed;
  return json;
}

std::string comparison_text(const design::Comparison& comparison) {
  std::vector<std::vector<std::string>> rows = {{"gains", "settle in", "least modulus", ""}};
  std::string refusals;
  for (std::size_t k = 0; k < comparison.candidates.size(); ++k) {
    const Candidate& each = comparison.candidates[k];
    const std::string name(base::name_of(each.structure));
    if (!each.design) {
      rows.push_back({name, "none found"});
      refusals += fmt::format("  {}: {}\n", name, each.refusal);
      continue;
    }
    rows.push_back({name, certify::settling_text(each.design->loop.modes.settling_s),
                    fmt::format("{:.2f}", each.design->modulus_in_range),
                    k == comparison.chosen ? "<- taken" : ""});
  }
  const Candidate& chosen = comparison.candidates[comparison.chosen];
  const char* const other = chosen.structure == Structure::scheduled ? "diagonal" : "scheduled";
  return base::table(rows, "l") + refusals +
         fmt::format("  {}; --structure {} takes the others\n", comparison.reason, other) +
         joints_text(comparison.candidates, *chosen.scenario.model);
}

nlohmann::ordered_json comparison_json(const design::Comparison& comparison) {
  nlohmann::ordered_json all = nlohmann::ordered_json::array();
  for (std::size_t k = 0; k < comparison.candidates.size(); ++k) {
    const Candidate& each = comparison.candidates[k];
    const bool taken = k == comparison.chosen;
    nlohmann::ordered_json row = {{"structure", base::name_of(each.structure)},
                                  {"law", design::law_of(each.structure)},
                                  {"taken", taken}};
    if (each.design) {
      const certify::Prediction& loop = each.design->loop;
      row["settling_s"] = loop.modes.settling_s;
      row["stiffness"] = json_list(loop.stiffness);
      row["rest_error"] = json_list(loop.rest_error);
      if (loop.count_Nm) row["count_torque_Nm"] = json_list(*loop.count_Nm);
      row["modulus_in_range"] = each.design->modulus_in_range;
    } else {
      row["refusal"] = each.refusal;
    }
    if (taken) row["reason"] = comparison.reason;
    all.push_back(std::move(row));
  }
  return all;
}

std::string assumptions_text(const std::vector<std::string>& assumed) {
  std::string text;
  for (const std::string& each : assumed) {
    text += (text.empty() ? "assumes   " : "          ") + each + "\n";
  }
  return text;
}

std::string finger_lock(const robot::Model& model) {
  constexpr double longest_slide = 0.1;  // [m]
  std::vector<std::string> fingers;
  for (int i = 0; i < model.num_joints; ++i) {
    const auto j = static_cast<std::size_t>(i);
    std::string name = model.joint_names[j];
    std::ranges::transform(name, name.begin(), [](unsigned char c) { return std::tolower(c); });
    const auto named = [&](const char* word) { return name.find(word) != std::string::npos; };
    const auto [low, high] = robot::finite_range(model, i);
    const bool slides =
        model.joint_types[j] == robot::JointType::prismatic && high - low < longest_slide;
    if (!slides && !named("finger") && !named("gripper") && !named("jaw")) continue;
    fingers.push_back(fmt::format("{}: {:.3g}", model.joint_names[j], 0.5 * (low + high)));
  }
  if (fingers.empty()) return "";
  return "--set 'robot.locked={" + base::joined(fingers) + "}'";
}

std::string ways_out(const scenario::Scenario& scenario) {
  std::vector<std::string> ways;
  if (scenario.robot.rigid_rotor_inertia_kgm2.isZero(0)) {
    ways.emplace_back(
        "give the rotors' inertia (--rotors typical, or --set robot.joint_parameters=FILE)");
  }
  if (scenario.controller.law != design::law_of(Structure::scheduled)) {
    ways.emplace_back("take --structure scheduled");
  }
  if (!scenario.controller.friction.given()) {
    const Vector& coulomb = scenario.plant.drive.coulomb_friction_Nm;
    ways.push_back(
        fmt::format("feed the friction forward (--set 'controller.friction={{coulomb: "
                    "[{}]}}')",
                    fmt::join(coulomb, ", ")));
  }
  ways.emplace_back("give finer encoders (--set plant.encoder.resolution_bits=24)");
  if (const std::string lock = finger_lock(*scenario.model); !lock.empty()) {
    ways.push_back("lock the fingers (" + lock + ")");
  }
  return base::joined(ways, ", or ");
}

}  // namespace tachless::cli

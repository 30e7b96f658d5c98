#include "controller/registry.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/failure.h"
#include "base/text.h"
#include "controller/laws.h"
#include "robot/cholesky.h"
#include "scenario/gains.h"

namespace tachless::controller {
namespace {

template <class... L>
std::vector<LawFacts> facts_of_all(LawList<L...> /*laws*/) {
  return {facts_of<L>()...};
}

/// Returns the names of the laws or parameters that `wanted` selects.
template <class Named>
std::vector<std::string_view> names_of(
    const std::vector<Named>& all,
    bool (*wanted)(const Named&) = [](const Named& /*each*/) { return true; }) {
  std::vector<std::string_view> names;
  for (const Named& each : all) {
    if (wanted(each)) names.push_back(each.name);
  }
  return names;
}

/// Returns "; did you mean loria_ortega_rigid?", or ";" if no name is similar.
std::string suggestion(std::string_view word, const std::vector<std::string_view>& names) {
  const auto nearest = base::nearest(word, names);
  return nearest ? fmt::format("; did you mean {}?", *nearest) : ";";
}

std::string no_such_law(std::string_view name) {
  return fmt::format("no law \"{}\"{} Allowed: {}", name, suggestion(name, law_names()),
                     base::joined(law_names()));
}

std::string shown(const Vector& value) {
  return fmt::format("[{:g}]", fmt::join(value.begin(), value.end(), ", "));
}

std::string gain_key(std::string_view gain) { return fmt::format("controller.gains.{}", gain); }

/// Returns the gains as "kp [N m/rad], kd [N m s/rad]".
std::string gains_text(const LawFacts& law) {
  std::vector<std::string> gains;
  for (const Parameter& each : law.parameters) {
    gains.push_back(each.unit.empty() ? std::string(each.name)
                                      : fmt::format("{} [{}]", each.name, each.unit));
  }
  return base::joined(gains);
}

void require_known_gains(const scenario::Scenario& scenario, const LawFacts& law) {
  const std::vector<std::string_view> names = parameter_names(law);
  for (const auto& [gain, value] : scenario.controller.gains) {
    if (std::ranges::find(names, gain) != names.end()) continue;
    throw scenario.complaint(
        gain_key(gain),
        fmt::format("{} has no such gain{} its gains: {}; --set 'controller.gains={{…}}' replaces "
                    "them all",
                    law.name, suggestion(gain, names), gains_text(law)));
  }
}

/// Returns the law's model of the robot, in the plant's gravity.
robot::Model known_model(const scenario::Scenario& scenario) {
  robot::Model model = scenario.believed_model ? *scenario.believed_model : *scenario.model;
  model.gravity = scenario.model->gravity;
  return model;
}

}  // namespace

const std::vector<LawFacts>& laws() {
  static const std::vector<LawFacts> all = facts_of_all(Laws{});
  return all;
}

std::vector<std::string_view> law_names() { return names_of(laws()); }

const LawFacts& law_facts(const scenario::Scenario& scenario) {
  try {
    return law_facts(scenario.controller.law);
  } catch (const base::Failure& problem) {
    throw scenario.complaint("controller.law", problem.what());
  }
}

const LawFacts& law_facts(std::string_view name) {
  static const LawFacts external{.name = controller::external_law_name,
                                 .source = "the program that --controller names",
                                 .no_linearisation = "it is computed by another program",
                                 .has_feedforward_lead = true};  // the program decides it
  if (name == external.name) return external;
  for (const LawFacts& law : laws()) {
    if (law.name == name) return law;
  }
  throw base::bad_usage(no_such_law(name));
}

std::vector<std::string_view> parameter_names(const LawFacts& law) {
  return names_of(law.parameters);
}

scenario::Gains gains_of_law(scenario::Gains gains, const LawFacts& law) {
  std::erase_if(gains, [names = parameter_names(law)](const auto& gain) {
    return std::ranges::find(names, gain.first) == names.end();
  });
  return gains;
}

robot::Model rigid_model(const scenario::Scenario& scenario) {
  robot::Model model = known_model(scenario);
  model.rotor_inertia = scenario.robot.flexible ? scenario.robot.flexible->rotor_inertia
                                                : scenario.robot.rigid_rotor_inertia_kgm2;
  return model;
}

law::FlexibleRobot flexible_robot(const scenario::Scenario& scenario) {
  if (!scenario.robot.flexible) throw scenario.complaint("robot.joints", "rigid; needed: flexible");
  return {known_model(scenario), scenario.robot.flexible->stiffness,
          scenario.robot.flexible->rotor_inertia};
}

law::Settings law_settings(const scenario::Scenario& scenario) {
  law::Settings settings;
  settings.period_s = scenario.loop.period_s;
  settings.filter = scenario.controller.filter;
  settings.command_delay = scenario.loop.command_delay + scenario.plant.encoder.latency_ticks;
  settings.filter_start = scenario.controller.filter_start;
  settings.friction = scenario.controller.friction;
  settings.torque_limit = scenario.plant.drive.torque_limit_Nm.value_or(Vector());
  if (scenario.controller.feedforward_lead == controller::FeedforwardLead::half_tick_plus_delay) {
    settings.feedforward_lead_s = (0.5 + settings.command_delay) * settings.period_s;
  }
  // A rounding error is distributed uniformly over one count, so its variance is a twelfth of the
  // count's square.
  const double noise = scenario.plant.encoder.noise_std_rad;
  const Vector count = scenario::encoder_count(scenario, *scenario.model);
  settings.position_std = (count.array().square() / 12 + noise * noise).sqrt();
  return settings;
}

/// Returns "[100, 100]", a list with that example for each joint.
std::string example_of(int num_joints, std::string_view example) {
  std::string list = "[" + std::string(example);
  for (int i = 1; i < num_joints; ++i) list += ", " + std::string(example);
  return list + "]";
}

bool has_torque_limits(const scenario::Scenario& scenario) {
  const auto& limit = scenario.plant.drive.torque_limit_Nm;
  return limit && limit->allFinite();
}

void require_compatible(const scenario::Scenario& scenario, const LawFacts& law) {
  if (law.needs_flexible_joints && !scenario.robot.flexible) {
    const auto rigid = names_of<LawFacts>(
        laws(), [](const LawFacts& each) { return !each.needs_flexible_joints; });
    throw scenario.complaint(
        "controller.law",
        fmt::format("{} needs flexible joints, and the joints are rigid; give "
                    "the springs and rotors, --set 'robot.joints={{flexible: "
                    "{{stiffness_Nm_per_rad: {}, rotor_inertia_kgm2: {}}}}}', "
                    "or a law allowed on rigid joints: {}",
                    law.name, example_of(scenario.model->num_joints, "10000"),
                    example_of(scenario.model->num_joints, "0.1"), base::joined(rigid)));
  }
  if (scenario.controller.law != controller::external_law_name) {
    scenario.require_law({std::string(law.name), std::string(law.measurement), {}});
  }
  if (law.needs_torque_limit && !has_torque_limits(scenario)) {
    throw scenario.complaint(
        "plant.drive.torque_limit_Nm",
        fmt::format(
            "not given for each joint, and {} keeps the torques within "
            "these limits; give a torque of each joint, --set plant.drive.torque_limit_Nm='{}'",
            law.name, example_of(scenario.model->num_joints, "100")));
  }
  if (law.regulation_only &&
      !std::holds_alternative<reference::trajectory::Hold>(scenario.reference)) {
    throw scenario.complaint(
        "controller.law",
        fmt::format("{} regulates, and the reference moves; allowed reference: hold", law.name));
  }
  if (!law.has_feedforward_lead &&
      scenario.controller.feedforward_lead != controller::FeedforwardLead::none) {
    throw scenario.complaint(
        "controller.feedforward_lead",
        fmt::format("half_tick_plus_delay, but {} differentiates its feed-forward twice and would "
                    "need derivatives beyond snap; allowed: none",
                    law.name));
  }
  scenario::require_encoders(scenario, law.measurement);
  if (scenario.robot.flexible && scenario.controller.friction.given()) {
    throw scenario.complaint("controller.friction",
                             "given, and the joints are flexible: a torque of the motors does not "
                             "act on the links at once; allowed: none");
  }
  require_known_gains(scenario, law);
}

std::optional<Vector> given_parameter(const scenario::Scenario& scenario, const LawFacts& law,
                                      const Parameter& parameter) {
  const auto found = scenario.controller.gains.find(std::string(parameter.name));
  if (found == scenario.controller.gains.end()) {
    if (!parameter.required) return std::nullopt;
    throw scenario.complaint("controller.gains",
                             fmt::format("{} is missing; gains of {}: {}", parameter.name, law.name,
                                         base::joined(parameter_names(law))));
  }
  const Vector& value = found->second;
  const Eigen::Index n = scenario.num_joints;
  if (parameter.shape == base::Shape::matrix) {
    Matrix matrix = Matrix::Zero(n, n);
    if (value.size() == n) matrix.diagonal() = value;
    if (value.size() == n * n) matrix = value.reshaped(n, n);
    Matrix factors = matrix;
    if (matrix != matrix.transpose() || robot::factorise(factors) >= 0) {
      throw scenario.complaint(gain_key(parameter.name),
                               fmt::format("{}; allowed: {}", shown(value), parameter.allowed));
    }
    return value;
  }
  if (value.size() != n) {
    throw scenario.complaint(gain_key(parameter.name),
                             fmt::format("{} has {} entries; needed: one per joint, {}",
                                         shown(value), value.size(), scenario.num_joints));
  }
  const auto allowed = [&](double entry) {
    const bool as_first = parameter.shape == base::Shape::joints || entry == value[0];
    const bool whole = parameter.shape != base::Shape::whole || entry == std::trunc(entry);
    return parameter.range.contains(entry) && as_first && whole;
  };
  if (!std::all_of(value.begin(), value.end(), allowed)) {
    throw scenario.complaint(gain_key(parameter.name),
                             fmt::format("{}; allowed: {}", shown(value), parameter.allowed));
  }
  return value;
}

base::Failure not_finite(std::string_view law, const Vector& tau, std::int64_t tick) {
  const auto finite = [](double each) { return std::isfinite(each); };
  const auto joint = std::ranges::find_if_not(tau, finite) - tau.begin() + 1;
  return {base::ExitCode::protective_stop,
          "{} of law {} at tick {} is not finite: the loop is unstable; shorten loop.period_s or "
          "soften the gains",
          joint > tau.size() ? "the state" : fmt::format("the torque of joint {}", joint), law,
          tick};
}

base::Failure gains_refused(std::string_view gains, std::string_view problem) {
  return {base::ExitCode::protective_stop, "the gains \"{}\" of a reference were rejected: {}",
          gains, problem};
}

scenario::Scenario with_gains(scenario::Scenario scenario, std::string_view gains) {
  if (gains.empty()) return scenario;
  const auto changed = scenario::read_gains(gains, scenario.num_joints);
  if (!changed) {
    throw base::bad_usage("\"{}\" is not name=number,number;name=number", gains);
  }
  for (const auto& [name, value] : *changed) scenario.controller.gains[name] = value;
  return scenario;
}

void require_same_counts(const scenario::Scenario& before, const scenario::Scenario& after,
                         const LawFacts& law) {
  for (const Parameter& each : law.parameters) {
    if (each.shape != base::Shape::whole ||
        given_parameter(before, law, each) == given_parameter(after, law, each)) {
      continue;
    }
    throw after.complaint(gain_key(each.name),
                          "a count sizes the law's memory and stays as the run began");
  }
}

messages::LawInfo law_info(const AnyLaw& law) {
  return {std::string(law.name()), std::string(law.measurement()),
          messages::text_of(law.signals())};
}

messages::Layout law_layout(const scenario::Scenario& scenario, const AnyLaw& law) {
  return messages::layout(scenario.num_joints, scenario.robot.flexible.has_value(),
                          static_cast<int>(law.signals().size()));
}

ScenarioLaw scenario_law(const scenario::Scenario& scenario) {
  if (scenario.controller.law == controller::external_law_name) {
    throw scenario.complaint(
        "controller.law",
        "external: the law is in a program of yours; run, replay, certify and design take it with "
        "--controller 'PROGRAM'; compare and sweep need one of tachless's laws");
  }
  ScenarioLaw chosen;
  const bool found = with_law(scenario.controller.law, [&]<class L>(std::type_identity<L> /*law*/) {
    chosen = law_over_run<L>(scenario, law_facts(L::name));
  });
  if (!found) throw scenario.complaint("controller.law", no_such_law(scenario.controller.law));
  return chosen;
}

}  // namespace tachless::controller

// The verbs that show what a scenario is made of: laws, robot.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "base/json_text.h"
#include "base/logging.h"
#include "base/text.h"
#include "cli/verb.h"
#include "controller/registry.h"
#include "report/robot_facts.h"
#include "robot/urdf_xml.h"
#include "scenario/scenario.h"
#include "session/options.h"

namespace tachless::cli {
namespace {

using base::ExitCode;
using controller::LawFacts;
using controller::Parameter;
using Json = nlohmann::ordered_json;

std::string_view joints_of(const LawFacts& law) {
  return law.needs_flexible_joints ? "flexible" : "rigid";
}

std::string default_text(const Parameter& parameter) {
  return parameter.described_default.empty() ? "has a default"
                                             : std::string(parameter.described_default);
}

std::string page(const LawFacts& law) {
  std::string text =
      fmt::format("{}\n  measures    {}, on {} joints{}\n", law.name, law.measurement,
                  joints_of(law), law.regulation_only ? "; the reference has to be constant" : "");
  for (const Parameter& parameter : law.parameters) {
    text += fmt::format("  {:<17} [{}]: {}; {}{}\n", parameter.name, parameter.unit,
                        parameter.meaning, parameter.allowed,
                        parameter.required ? "" : "; if not given: " + default_text(parameter));
  }
  // A line for each condition; "; " separates them.
  const std::string conditions = base::joined(base::split(law.conditions, ';'), ";\n             ");
  return text + fmt::format("  proved      {}\n  conditions  {}\n  source      {}\n", law.proved,
                            conditions, law.source);
}

Json to_json(const LawFacts& law) {
  Json json = {{"name", law.name},
               {"measures", law.measurement},
               {"joints", joints_of(law)},
               {"regulation_only", law.regulation_only},
               {"feedforward_lead", law.has_feedforward_lead}};
  for (const Parameter& parameter : law.parameters) {
    Json& last = json["parameters"].emplace_back(Json{{"name", parameter.name},
                                                      {"unit", parameter.unit},
                                                      {"meaning", parameter.meaning},
                                                      {"allowed", parameter.allowed},
                                                      {"required", parameter.required}});
    if (!parameter.required) last["default"] = default_text(parameter);
  }
  for (const messages::Signal& signal : law.signals) {
    json["signals"].push_back({{"name", signal.name}, {"unit", signal.unit}});
  }
  json.update({{"proved", law.proved}, {"conditions", law.conditions}, {"source", law.source}});
  return json;
}

/// A line of the table of laws.
std::string row(std::string_view name, std::string_view joints, std::string_view reference,
                std::string_view measures, std::string_view gains) {
  return fmt::format("{:<22} {:<9} {:<9} {:<15} {}\n", name, joints, reference, measures, gains);
}

struct Laws {
  std::string name;
  bool json = false;

  void declare(CLI::App& command) {
    command.add_option("NAME", name, "The page of one law; default: a table of all");
    add_json(command, json);
  }

  [[nodiscard]] ExitCode run() const {
    std::vector<LawFacts> laws = controller::laws();
    if (!name.empty()) laws = {controller::law_facts(name)};
    Json all = Json::array();
    std::string text = name.empty() ? row("law", "joints", "reference", "measures", "gains") : "";
    for (const LawFacts& law : laws) {
      all.push_back(to_json(law));
      text += !name.empty() ? page(law)
                            : row(law.name, joints_of(law), law.regulation_only ? "rests" : "moves",
                                  law.measurement, base::joined(controller::parameter_names(law)));
    }
    std::cout << (json ? base::json_text(all, 2) + "\n" : text);
    return ExitCode::done;
  }
};

struct Robot {
  std::filesystem::path file;
  std::vector<std::string> overrides;
  std::vector<double> position;
  bool json = false, strict = false;

  void declare(CLI::App& command) {
    session::with_installed_scenarios(
        command.add_option("FILE", file, "A URDF or .xacro file, or a scenario"))
        ->required();
    session::add_overrides(command, overrides,
                           "robot.key=value, as in a scenario; may be repeated");
    command
        .add_option("--position", position,
                    "a,b,... in the order of the joints [rad; m]; default: as near to 0 as their "
                    "ranges allow")
        ->delimiter(',');
    command.add_flag("--strict", strict, "Exit code 1 where there is a warning");
    add_json(command, json);
  }

  [[nodiscard]] ExitCode run() const {
    std::optional<std::string> refusal;
    std::vector<std::string> doubts;
    std::optional<scenario::Scenario> scenario;
    if (is_yaml(file)) scenario = scenario::load_scenario(file, overrides);
    report::RobotFacts facts(scenario ? model_in_use(*scenario) : read(refusal, doubts), position);
    if (scenario) {
      add_sources(*scenario, facts);
      doubts = doubts_of(*scenario);
    }
    facts.warnings.insert(facts.warnings.end(), doubts.begin(), doubts.end());
    add_loads(facts);
    print_text(json ? base::json_text(to_json(facts), 2) + "\n"
                    : file.string() + ": " + to_text(facts));
    if (!refusal) {
      return strict && !facts.warnings.empty() ? ExitCode::check_said_no : ExitCode::done;
    }
    base::log_error(*refusal);
    return ExitCode::check_said_no;
  }

 private:
  /// Adds a warning for each joint whose friction, or gravity torque at the position, is beyond its
  /// effort limit.
  static void add_loads(report::RobotFacts& facts) {
    const robot::Model& model = facts.model;
    for (int j = 0; j < model.num_joints; ++j) {
      const std::string& joint = model.joint_names[static_cast<std::size_t>(j)];
      const double effort = model.effort_limit[j], gravity = std::abs(facts.gravity_torque[j]);
      if (model.friction[j] > effort) {
        facts.warnings.push_back(
            fmt::format("joint '{}': friction {:g} is above the effort limit {:g}", joint,
                        model.friction[j], effort));
      }
      if (gravity > effort) {
        facts.warnings.push_back(fmt::format(
            "joint '{}': gravity torque {:g} at this position is above the effort limit {:g}",
            joint, gravity, effort));
      }
    }
  }

  /// Returns the model with the numbers that the loop of a scenario uses. The inertia matrix has
  /// the rotors of rigid joints.
  static robot::Model model_in_use(const scenario::Scenario& scenario) {
    robot::Model model = *scenario.model;
    const plant::DriveSpec& drive = scenario.plant.drive;
    model.rotor_inertia = scenario.robot.rigid_rotor_inertia_kgm2;
    model.damping = drive.viscous_friction_Nms_per_rad;
    model.friction = drive.coulomb_friction_Nm;
    model.effort_limit =
        drive.torque_limit_Nm.value_or(Vector::Constant(model.num_joints, robot::Model::unlimited));
    return model;
  }

  /// Returns the improbable numbers of the robot's URDF; nothing where the law has one of its own,
  /// since the text is then of both.
  static std::vector<std::string> doubts_of(const scenario::Scenario& scenario) {
    if (!scenario.controller.urdf_path.empty()) return {};
    return robot::improbable_numbers(scenario.robot.urdf_text, scenario.robot.urdf_path,
                                     scenario.robot.locked);
  }

  /// Adds the source of each number that the loop uses.
  static void add_sources(const scenario::Scenario& scenario, report::RobotFacts& facts) {
    const scenario::RobotSpec& robot = scenario.robot;
    const auto source = [&](const std::string& key, const std::string& otherwise) {
      const auto where = scenario.where.find(key);
      return where == scenario.where.end() ? otherwise : fmt::format("{} ({})", key, where->second);
    };
    const std::string urdf = robot.urdf_path;
    const auto friction = [&](const std::string& key, const char* attribute) {
      const std::string whole =
          source("plant.drive." + key, fmt::format("<dynamics {}> of {}", attribute, urdf));
      if (robot.compensates.friction == 0) return whole;
      return fmt::format("{}, without what {} cancels", whole,
                         source("robot.compensates.friction", ""));
    };
    if (robot.flexible) facts.rotor_inertia = robot.flexible->rotor_inertia;
    facts.sources = {
        {"lower, upper, velocity", "<limit> of " + urdf},
        {"effort", source("plant.drive.torque_limit_Nm", "<limit effort> of " + urdf)},
        {"damping", friction("viscous_friction_Nms_per_rad", "damping")},
        {"friction", friction("coulomb_friction_Nm", "friction")},
        {"rotor",
         source(fmt::format("robot.joints.{}.rotor_inertia_kgm2",
                            robot.flexible ? "flexible" : "rigid"),
                robot.rigid_rotor_inertia_kgm2.isZero(0) ? "none is given: 0"
                                                         : "<dynamics armature> of " + urdf)},
        {"inertia, gravity torque",
         urdf + (robot.flexible ? ", without the rotors behind the springs" : ", with rotor")}};
    if (scenario.plant.payload.mass_kg > 0) {
      facts.sources.back().second += fmt::format(", without the payload of the plant: {}",
                                                 source("plant.payload.mass_kg", ""));
    }
    if (!scenario.controller.urdf_path.empty()) {
      facts.sources.emplace_back("model of the law", source("controller.urdf", ""));
    }
  }

  /// Shows what a scenario needs `robot.check_inertia: warn` for too; `refusal` is then its
  /// message. @param doubts gets the improbable numbers
  robot::Model read(std::optional<std::string>& refusal, std::vector<std::string>& doubts) const {
    for (const std::string& each : overrides) {
      bool known = false;
      for (const char* key : {"robot.xacro", "robot.locked", "robot.base", "robot.check_inertia"}) {
        known = known || each.starts_with(key);
      }
      if (known) continue;
      throw base::bad_usage(
          "--set {}: does not change how a URDF is read; allowed: robot.xacro, robot.locked, "
          "robot.base, robot.check_inertia, or a scenario as FILE",
          each);
    }
    const scenario::RobotFile given = scenario::robot_file(file, overrides);
    const std::string& text = given.urdf;
    const robot::UrdfOptions& options = given.options;
    try {
      doubts = robot::improbable_numbers(text, file.string(), options.locked);
      doubts.insert(doubts.begin(), given.warnings.begin(), given.warnings.end());
      try {
        return robot::model_from_urdf(text, file.string(), options);
      } catch (const std::invalid_argument& problem) {
        refusal = problem.what();
      }
      robot::UrdfOptions lenient = options;
      lenient.check_inertia = robot::CheckInertia::warn;
      return robot::model_from_urdf(text, file.string(), lenient);
    } catch (const std::invalid_argument& problem) {
      throw base::bad_usage(refusal.value_or(problem.what()));
    }
  }
};

}  // namespace

const Verb laws_verb = verb_of<Laws>(
    "laws", "Shows the control laws in a table, or one law's parameters, conditions and source",
    "  tachless laws\n"
    "  tachless laws loria_ortega_rigid\n"
    "  tachless laws --json");

const Verb robot_verb = verb_of<Robot>(
    "robot",
    "Shows a URDF as it is read: joints, limits, masses; torques and inertia at a position",
    "  tachless robot robot.urdf\n"
    "  tachless robot ur.urdf.xacro --set robot.xacro.ur_type=ur5e\n"
    "  tachless robot scenarios/robots/two_link.urdf --position 0.5,-1 --json");

}  // namespace tachless::cli

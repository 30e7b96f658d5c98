// The verbs on the stability of a loop that is not run: certify, design.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "base/file_text.h"
#include "base/logging.h"
#include "base/text.h"
#include "certify/certify.h"
#include "cli/progress.h"
#include "cli/run.h"
#include "cli/verb.h"
#include "controller/registry.h"
#include "design/design.h"
#include "lyapunov/witness.h"
#include "robot/urdf_xml.h"
#include "scenario/scenario.h"
#include "session/options.h"

namespace tachless::cli {
namespace {

namespace fs = std::filesystem;
using base::ExitCode;

void warn(const scenario::Scenario& scenario) {
  (void)controller::law_facts(scenario);
  for (const std::string& warning : scenario.model->warnings) base::log_warning(warning);
}

/// @throw base::Failure(bad_usage) when there is neither one number nor one for each joint
Vector one_a_joint(std::string_view option, const std::vector<double>& given, int joints) {
  if (given.size() > 1 && std::ssize(given) != joints) {
    throw base::bad_usage("{} has {} numbers; allowed: 1, or {}, one a joint", option, given.size(),
                          joints);
  }
  Vector all(joints);
  for (int i = 0; i < joints; ++i) {
    all[i] = given[given.size() == 1 ? 0 : static_cast<std::size_t>(i)];
  }
  return all;
}

/// Returns the overrides that put a program's law in the place of the scenario's, and `overrides`.
std::vector<std::string> of_program(const fs::path& scenario, std::vector<std::string> overrides,
                                    const std::string& law_program) {
  RunOptions options;
  options.scenario = scenario;
  options.overrides = std::move(overrides);
  options.law_program = law_program;
  options.measurement = measurement_wanted(options);
  options.overrides.clear();
  return options.all_overrides();
}

struct Certify {
  fs::path input;
  std::vector<std::string> overrides;
  fs::path witness;
  std::vector<double> errors = {0.3};
  std::string law_program;
  bool full = false, paper = false, force = false, json = false, quiet = false;

  void declare(CLI::App& command) {
    session::with_installed_scenarios(session::add_scenario(command, input, overrides));
    command.add_option(
        "--witness", witness,
        "Also writes data from which tests/analysis/lyapunov/check_witness.py proves a region of "
        "the sampled loop of one or two joints");
    auto* const error = command.add_option(
        "--witness-error", errors,
        "Error [rad] of one joint alone, from rest, that the region has to contain: one number, "
        "or one for each joint; default: 0.3");
    error->delimiter(',')->check(above_zero)->needs("--witness");
    command.add_flag("--force", force, "Replace the file of --witness if it exists")
        ->needs("--witness");
    command.add_option(
        "--controller", law_program,
        "The law is in this program, as typed in a shell: 'python3 law.py'; its linear model "
        "comes from its answers to small deviations");
    command.add_flag(
        "--full", full,
        "All numbers in place of five lines, and the searches that take seconds: the nonlinear "
        "sampled loop, missed ticks in lock-step. With --json too");
    command.add_flag(
        "--paper", paper,
        "Also the conditions that Loria and Ortega (1995) print, with their constants");
    add_json(command, json);
    add_quiet(command, quiet);
  }

  [[nodiscard]] ExitCode run() const {
    require_writable(witness, force);
    std::vector<std::string> all_overrides = of_program(input, overrides, law_program);
    all_overrides.insert(all_overrides.begin(), overrides.begin(), overrides.end());
    scenario::Scenario scenario = scenario::load_scenario(input, all_overrides);
    warn(scenario);
    if (!witness.empty()) {
      const Vector each = one_a_joint("--witness-error", errors, scenario.num_joints);
      base::UnfinishedFile(witness, "name another file with --witness")
          .write(lyapunov::witness(scenario, each));
    }
    const linear::LawAnswers answers = law_answers(scenario, law_program);
    Screen screen(quiet);
    const certify::Certificate result = certify::certify(
        scenario, paper,
        [&](std::string_view what) { screen.show(fmt::format("certify: {}", what)); }, full,
        answers);
    screen.clear();
    nlohmann::ordered_json all = {{"scenario", scenario.name},
                                  {"law", scenario.controller.law_text()}};
    all.update(to_json(result));
    print(json, std::move(all), page(result, scenario, full));
    std::vector<std::string> objections = certify::objections(result);
    if (answers && !result.loop.unknown.empty()) objections.push_back(text(result.loop));
    for (const std::string& objection : objections) {
      base::log_error("{}: {}", input.string(), objection);
    }
    return objections.empty() ? ExitCode::done : ExitCode::check_said_no;
  }
};

/// For people.
std::string text(const design::Design& design, const scenario::Scenario& scenario) {
  std::string text = fmt::format(
      "{}: gains of {} at h = {}, delay {}\n", scenario.name, scenario.controller.law_text(),
      base::period_text(scenario.loop.period_s), scenario.loop.command_delay);
  for (const std::string& gain : design::overrides_of(design)) {
    text += fmt::format("  --set '{}'\n", gain);
  }
  const auto line = [&](const std::string& what) { text += "  " + what + "\n"; };
  const certify::Prediction& loop = design.loop;
  line(certify::text(loop));
  line(fmt::format("settling of an error of one joint alone: {} the slowest, {} the mean",
                   certify::settling_text(loop.modes.settling_s),
                   certify::settling_text(loop.modes.settling_mean_s)));
  line(fmt::format("margins: {}; modulus {} at q = {}", certify::margins_text(*loop.margins),
                   certify::modulus_text(*loop.margins), certify::list_text(loop.margin_q)));
  line(fmt::format("least modulus margin found in the joints' range: {:.2g} at q = {}",
                   design.modulus_in_range, certify::list_text(design.range_q)));
  line(fmt::format("stiffness {} {}", certify::list_text(loop.stiffness), loop.stiffness_unit));
  if (const std::string held = certify::friction_text(loop); !held.empty()) line(held);
  if (loop.count_Nm) {
    line(fmt::format("torque of one encoder count {} {}", certify::list_text(*loop.count_Nm),
                     loop.torque_unit));
  }
  for (const std::string& each : design.binds) line("limited by " + each);
  return text;
}

nlohmann::ordered_json to_json(const design::Design& design, const scenario::Scenario& scenario) {
  const auto list = [](const Vector& v) { return std::vector<double>(v.begin(), v.end()); };
  nlohmann::ordered_json json = {{"scenario", scenario.name},
                                 {"law", scenario.controller.law_text()}};
  for (const auto& [gain, values] : design.gains) json["gains"][gain] = list(values);
  json["overrides"] = design::overrides_of(design);
  json["sampled"] = to_json(design.loop);
  json["settling_mean_s"] = design.loop.modes.settling_mean_s;
  json["stiffness"] = list(design.loop.stiffness);
  json["modulus_in_range"] = design.modulus_in_range;
  json["range_q"] = list(design.range_q);
  json["limited_by"] = design.binds;
  json["warnings"] = design.warnings;
  json["reached"] = !design.missed;
  return json;
}

struct Design {
  fs::path input;
  std::vector<std::string> overrides;
  design::DesignGoal goal;
  std::vector<double> stiffness, rest_error, from;
  double period_s = 0;
  std::string structure, law_program;
  fs::path output;
  bool json = false, quiet = false, force = false;

  void declare(CLI::App& command) {
    session::with_installed_scenarios(
        command.add_option("SCENARIO", input, "A scenario, or a URDF file"))
        ->required();
    session::add_overrides(command, overrides, "key.path=value; may be repeated");
    const auto add = [&](const char* name, auto& number, const char* does) {
      return command.add_option(name, number, does)->check(above_zero);
    };
    add("--bandwidth", goal.bandwidth_hz, "At most [Hz]; default: no bound");
    add("--settling", goal.settling_s, "To 1 % of an error [s]; default: as fast as possible");
    add("--stiffness", stiffness, "At least [N m/rad]: one number, or one for each joint")
        ->delimiter(',');
    add("--rest-error", rest_error,
        "TORQUE,ERROR: what a constant torque [N m] may displace at rest [rad]")
        ->delimiter(',')
        ->expected(2);
    add("--noise", goal.count_Nm, "Largest torque of one encoder count [N m]");
    add("--start-error", goal.start_error,
        "Initial error [rad] whose torque is to stay within the limit");
    command.add_option("--margin", goal.modulus, "Least modulus margin; default: 0.5")
        ->check(CLI::Range(0.05, 0.95));
    add("--count-share", goal.count_share,
        "Largest torque of one encoder count, as a part of the torque limit; default: 0.01");
    add("--period", period_s, "Sampling period [s]; default: the scenario's, 1 ms for a URDF");
    command
        .add_option("--structure", structure,
                    "diagonal, matrix or scheduled: the law loria_ortega_rigid, _matrix, with one "
                    "constant matrix for all postures, or _scheduled, with M(q_ref)")
        ->check(CLI::IsMember({"diagonal", "matrix", "scheduled"}));
    command.add_option("--from", from, "Of a URDF: where the motion begins [rad; m], one a joint")
        ->delimiter(',');
    auto* const program = command.add_option(
        "--controller", law_program,
        "The law is in this program, as typed in a shell, and takes its gains from the "
        "scenario's controller.gains, from which the search starts");
    for (const char* of_known_gains :
         {"--bandwidth", "--stiffness", "--rest-error", "--start-error", "--structure", "--from"}) {
      program->excludes(of_known_gains);
    }
    command.add_option("--write", output, "The scenario with these gains, as a file");
    command.add_flag("--force", force, "Replace that file if it exists");
    add_json(command, json);
    add_quiet(command, quiet);
  }

  [[nodiscard]] ExitCode run() const {
    scenario::Scenario scenario = load(of_program(input, overrides, law_program));
    warn(scenario);
    require_scenario_writable(output, force);
    const linear::LawAnswers answers = law_answers(scenario, law_program);
    Screen screen(quiet);
    const design::Design design = design::design(
        scenario, whole_goal(scenario.num_joints),
        [&](std::string_view what) { screen.show(what); }, answers);
    screen.clear();
    print(json, to_json(design, scenario), text(design, scenario));
    for (const std::string& warning : design.warnings) base::log_warning(warning);
    if (design.missed) {
      base::log_error("{}: settles in {}, not in {:g} s: limited by {}{}", input.string(),
                      certify::settling_text(design.loop.modes.settling_s), *design.missed,
                      design.binds.empty() ? "the law" : design.binds.front(),
                      output.empty() ? "" : "; nothing is written");
      return ExitCode::check_said_no;
    }
    if (!output.empty()) {
      base::UnfinishedFile(output, write_remedy).write(designed_text(scenario, design));
      if (!json) {
        std::cout << fmt::format(
            "  type: tachless run {}{}\n", base::shell_word(output.string()),
            law_program.empty() ? "" : " --controller " + base::shell_word(law_program));
      }
    }
    return ExitCode::done;
  }

 private:
  [[nodiscard]] design::DesignGoal whole_goal(int num_joints) const {
    design::DesignGoal whole = goal;
    if (stiffness.empty() && rest_error.empty()) return whole;
    Vector least = Vector::Zero(num_joints);
    if (!stiffness.empty()) least = one_a_joint("--stiffness", stiffness, num_joints);
    if (!rest_error.empty()) least = least.cwiseMax(rest_error[0] / rest_error[1]);
    whole.least_kp = least;
    return whole;
  }

  [[nodiscard]] bool bare_urdf() const {
    return !is_yaml(input) &&
           base::given_text(input, base::max_text_bytes).find("<robot") != std::string::npos;
  }

  /// The scenario, that of a bare URDF from text, with these overrides.
  [[nodiscard]] scenario::Scenario load(std::vector<std::string> more) const {
    if (period_s > 0) more.push_back(fmt::format("loop.period_s={}", period_s));
    if (!structure.empty()) {
      const char* law = structure == "diagonal" ? "rigid" : structure.c_str();
      more.insert(more.begin(),
                  {"controller.gains={}", fmt::format("controller.law=loria_ortega_{}", law)});
    }
    more.insert(more.begin(), overrides.begin(), overrides.end());
    if (!bare_urdf()) {
      if (from.empty()) return scenario::load_scenario(input, more);
      throw base::bad_usage(
          "--from: of a URDF; in a scenario set plant.initial.position_rad and reference");
    }
    for (const std::string& each : overrides) {
      if (!each.starts_with("robot.urdf=")) continue;
      throw base::bad_usage("--set {}: the URDF is {}; name another in its place", each,
                            input.string());
    }
    const auto [urdf, options] = scenario::robot_file(input, overrides);
    std::string scenario;
    try {
      const robot::Model model = robot::read_urdf(urdf, input.string(), options);
      for (const std::string& doubt :
           robot::improbable_numbers(urdf, input.string(), options.locked)) {
        base::log_warning(doubt);
      }
      scenario::UrdfScenario of{scenario_name(output.empty() ? input : output),
                                path_from(output, input), period_s > 0 ? period_s : 1e-3};
      if (!from.empty()) of.from = from_posture(model);
      scenario = scenario::urdf_scenario(model, of);
    } catch (const std::invalid_argument& problem) {
      throw base::bad_usage(problem.what());
    }
    return scenario::parse_scenario(scenario, urdf, input.string(), more);
  }

  /// @throw base::Failure(bad_usage) when it is not within the joints' limits
  [[nodiscard]] Vector from_posture(const robot::Model& model) const {
    if (std::ssize(from) != model.num_joints) {
      throw base::bad_usage("--from has {} numbers; allowed: {}, one a joint", from.size(),
                            model.num_joints);
    }
    for (int i = 0; i < model.num_joints; ++i) {
      const double q = from[static_cast<std::size_t>(i)];
      if (q >= model.lower[i] && q <= model.upper[i]) continue;
      throw base::bad_usage("--from: {:g} for joint {}; allowed: {:g} to {:g}", q,
                            model.joint_names[static_cast<std::size_t>(i)], model.lower[i],
                            model.upper[i]);
    }
    return Vector::Map(from.data(), std::ssize(from));
  }

  /// The scenario with the design's gains, as text.
  [[nodiscard]] std::string designed_text(const scenario::Scenario& scenario,
                                          const design::Design& design) const {
    std::vector<std::string> gains = design::overrides_of(design);
    // The files were read before the search: they may have changed since.
    const auto designed = [&] {
      if (!law_program.empty()) return load(std::move(gains));
      return scenario::parse_scenario(scenario.text, scenario.robot.urdf_text, input.string(),
                                      gains);
    };
    if (!bare_urdf()) return text_for(output, designed(), input);
    // The scenario goes on for 3 s after its motion. It is made longer if the slowest error needs
    // longer to vanish, up to a minute in all.
    const double h = scenario.loop.period_s;
    const double longer = std::max(0.0, 1.5 * design.loop.modes.settling_s - 3);
    const double ticks = std::ceil(std::min(60.0, scenario.loop.duration_s + longer) / h);
    gains.push_back(fmt::format("loop.duration_s={:.12g}", ticks * h));
    return designed().text;
  }
};

}  // namespace

const Verb certify_verb = verb_of<Certify>(
    "certify", "Checks the stability of a scenario's loop, with margins; runs nothing",
    "  tachless certify scenarios/paper_rigid.yaml\n"
    "  tachless certify scenarios/practical_rigid.yaml --set loop.period_s=0.002 "
    "--json\n"
    "  tachless certify scenarios/paper_rigid.yaml --full --paper");

const Verb design_verb = verb_of<Design>(
    "design", "Gains that keep a margin, for a scenario's law or for a bare URDF",
    "  tachless design scenarios/practical_rigid.yaml --settling 0.2\n"
    "  tachless design arm.yaml --controller ./own_law --write tuned.yaml\n"
    "  tachless design robot.urdf --bandwidth 3 --write robot.yaml && tachless run robot.yaml");

}  // namespace tachless::cli

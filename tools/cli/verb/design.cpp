// The verb design.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "base/file_text.h"
#include "base/logging.h"
#include "base/text.h"
#include "certify/certify.h"
#include "cli/design_input.h"
#include "cli/design_text.h"
#include "cli/progress.h"
#include "cli/run.h"
#include "cli/verb.h"
#include "controller/registry.h"
#include "design/design.h"
#include "design/structure.h"
#include "scenario/scenario.h"
#include "session/options.h"

namespace tachless::cli {
namespace {

namespace fs = std::filesystem;
using base::ExitCode;
using design::Structure;

struct Design {
  fs::path input;
  std::vector<std::string> overrides;
  design::DesignGoal goal;
  std::vector<double> stiffness, rest_error, from;
  double period_s = 0;
  std::string structure, rotors, law_program;  ///< empty where none is given
  std::string uncertain;                       ///< empty: the plant is the model
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
    add("--bandwidth", goal.bandwidth_hz, "Largest bandwidth [Hz]; default: no bound");
    add("--settling", goal.settling_s,
        "Time in which an error falls to 1 % [s]; default: as short as possible");
    add("--stiffness", stiffness, "Least stiffness [N m/rad]: one number, or one for each joint")
        ->delimiter(',');
    add("--rest-error", rest_error,
        "TORQUE,ERROR: largest error at rest [rad] under a constant torque [N m]")
        ->delimiter(',')
        ->expected(2);
    add("--noise", goal.count_Nm, "Largest torque of one encoder count [N m]");
    add("--start-error", goal.start_error,
        "Initial error [rad] whose torque has to stay within the limit");
    command.add_option("--margin", goal.modulus, "Least modulus margin; default: 0.5")
        ->check(CLI::Range(0.05, 0.95));
    command.add_option("--uncertain", uncertain,
                       "Set of plants for which the margin has to hold: "
                       "links=20%,rotors=30%,delay=1 (shares of the inertias, further ticks of "
                       "delay). rotors=0.1/0.02/… is an inertia for each joint [kg m2]");
    add("--count-share", goal.count_share,
        "Largest torque of one encoder count, as a share of the torque limit; default: 0.01");
    add("--period", period_s, "Sampling period [s]; default: the scenario's, 1 ms for a URDF");
    command
        .add_option(
            "--structure", structure,
            "diagonal: gains of each joint (loria_ortega_rigid). matrix: one constant matrix "
            "(loria_ortega_matrix). scheduled: gains by M(q_ref) (loria_ortega_scheduled). auto: "
            "compares diagonal and scheduled. Default: the scenario's law; for a URDF auto, or "
            "diagonal if --stiffness, --rest-error or --start-error is given")
        ->check(CLI::IsMember({"auto", "diagonal", "matrix", "scheduled"}));
    command
        .add_option("--from", from,
                    "Only for a URDF: start of the motion [rad; m], one number for each joint")
        ->delimiter(',');
    command
        .add_option("--rotors", rotors,
                    "Only for a URDF: typical sets each rotor's inertia to 0.003 s2 times the "
                    "effort limit, a rule of thumb; default: no rotors")
        ->check(CLI::IsMember({"typical"}));
    auto* const program = command.add_option("--controller", law_program,
                                             "Program with the law, as typed in a shell; the "
                                             "search starts from the scenario's controller.gains");
    for (const char* of_known_gains : {"--bandwidth", "--stiffness", "--rest-error",
                                       "--start-error", "--structure", "--from", "--rotors"}) {
      program->excludes(of_known_gains);
    }
    command.add_option("--write", output, "The scenario with these gains, as a file");
    command.add_flag("--force", force, "Replace that file if it exists");
    add_json(command, json);
    add_quiet(command, quiet);
  }

  [[nodiscard]] ExitCode run() const {
    require_scenario_writable(output, force);
    const design::DesignGoal common = common_goal();  // a wrong option ends before a file is read
    const DesignInput source({input, overrides, period_s, from, !rotors.empty(), output});
    Screen screen(quiet);
    const linear::OnProgress tell = [&](std::string_view what) { screen.show(what); };
    const Found found = compares(source) ? chosen(source, common, tell) : own(source, common, tell);
    screen.clear();
    const design::Design& design = found.design;
    nlohmann::ordered_json all = design_json(design, found.scenario);
    std::string text = assumptions_text(found.assumed);
    if (found.comparison) {
      all["structures"] = comparison_json(*found.comparison);
      text += comparison_text(*found.comparison);
    }
    if (!found.assumed.empty()) all["assumes"] = found.assumed;
    print(json, std::move(all), text + design_text(design, found.scenario));
    for (const std::string& warning : design.warnings) base::log_warning(warning);
    for (const std::string& objection : design.objections) base::log_error(objection);
    const std::string nothing = output.empty() ? "" : "; nothing is written";
    if (!design.objections.empty()) {
      base::log_error("{}: these gains are unusable{}: {}", input.string(), nothing,
                      ways_out(found.scenario));
      return ExitCode::check_said_no;
    }
    if (design.missed) {
      base::log_error("{}: settles in {}, not in {:g} s: limited by {}{}", input.string(),
                      certify::settling_text(design.loop.modes.settling_s), *design.missed,
                      design.binds.empty() ? "the law" : design.binds.front(), nothing);
      return ExitCode::check_said_no;
    }
    if (!output.empty()) {
      base::UnfinishedFile(output, write_remedy).write(designed_text(source, found));
      if (!json) {
        std::cout << fmt::format(
            "  type: tachless run {}{}\n", base::shell_word(output.string()),
            law_program.empty() ? "" : " --controller " + base::shell_word(law_program));
      }
    }
    return ExitCode::done;
  }

 private:
  struct Found {
    scenario::Scenario scenario;
    design::Design design;
    std::optional<design::Comparison> comparison;  ///< where structures were compared
    std::vector<std::string> assumed;
  };

  [[nodiscard]] bool names_a_law() const {
    return std::ranges::any_of(overrides, [](const std::string& each) {
      return each.starts_with("controller.law=") || each.starts_with("controller=");
    });
  }
  [[nodiscard]] bool of_joints() const {
    return !stiffness.empty() || !rest_error.empty() || goal.start_error;
  }

  /// Returns true if structures are compared.
  [[nodiscard]] bool compares(const DesignInput& source) const {
    if (!structure.empty()) return structure == "auto";
    return source.bare_urdf() && law_program.empty() && !names_a_law() && !of_joints();
  }

  /// Designs the gains of the structure asked for, or of the scenario's own law.
  [[nodiscard]] Found own(const DesignInput& source, const design::DesignGoal& common,
                          const linear::OnProgress& tell) const {
    std::optional<Structure> with;
    if (!structure.empty()) with = base::value_of<Structure>(structure);
    scenario::Scenario scenario = source.scenario(with, of_program(input, overrides, law_program));
    warn(scenario);
    design::Design design = design::design(scenario, whole_goal(common, scenario.num_joints), tell,
                                           law_answers(scenario, law_program));
    std::vector<std::string> assumed = source.assumptions(scenario);
    return {std::move(scenario), std::move(design), {}, std::move(assumed)};
  }

  /// Designs diagonal and scheduled gains, and chooses.
  [[nodiscard]] Found chosen(const DesignInput& source, const design::DesignGoal& common,
                             const linear::OnProgress& tell) const {
    if (of_joints()) {
      throw base::bad_usage(
          "--structure auto: the stiffness of single joints is asked for, which only diagonal "
          "gains have: take --structure diagonal");
    }
    bool warned = false;
    design::Comparison comparison = design::compare(
        [&](Structure each) {
          scenario::Scenario scenario = source.scenario(each);
          if (!std::exchange(warned, true)) warn(scenario);
          return scenario;
        },
        common, tell);
    const design::Candidate& best = comparison.candidates[comparison.chosen];
    scenario::Scenario scenario = best.scenario;
    design::Design design = *best.design;
    std::vector<std::string> assumed = source.assumptions(scenario);
    return {std::move(scenario), std::move(design), std::move(comparison), std::move(assumed)};
  }

  [[nodiscard]] design::DesignGoal common_goal() const {
    design::DesignGoal common = goal;
    if (!uncertain.empty()) common.uncertainty = design::parse_uncertainty(uncertain);
    return common;
  }
  [[nodiscard]] design::DesignGoal whole_goal(design::DesignGoal whole, int num_joints) const {
    if (stiffness.empty() && rest_error.empty()) return whole;
    Vector least = Vector::Zero(num_joints);
    if (!stiffness.empty()) least = one_a_joint("--stiffness", stiffness, num_joints);
    if (!rest_error.empty()) least = least.cwiseMax(rest_error[0] / rest_error[1]);
    whole.least_kp = least;
    return whole;
  }

  /// Returns whether the scenario has gains of another law, which `run` would refuse.
  [[nodiscard]] bool has_other_gains(const scenario::Scenario& scenario) const {
    if (!law_program.empty()) return false;
    const auto& [law, gains] = std::tie(scenario.controller.law, scenario.controller.gains);
    return controller::gains_of_law(gains, controller::law_facts(law)).size() != gains.size();
  }

  /// Returns the scenario with the design's gains, as text.
  [[nodiscard]] std::string designed_text(const DesignInput& source, const Found& found) const {
    const scenario::Scenario& scenario = found.scenario;
    std::vector<std::string> gains = design::overrides_of(found.design);
    if (has_other_gains(scenario)) gains.insert(gains.begin(), "controller.gains={}");
    // The files were read before the search: they may have changed since.
    const auto designed = [&] {
      if (!law_program.empty()) return source.scenario({}, std::move(gains));
      return scenario::parse_scenario(scenario.text, scenario.robot.urdf_text, input.string(),
                                      gains);
    };
    if (!source.bare_urdf()) {
      gains.push_back("name=" + scenario_name(output));
      return text_for(output, designed(), input);
    }
    // The scenario goes on for 3 s after its motion. It is made longer if the slowest error needs
    // longer to vanish, up to a minute in all.
    const double h = scenario.loop.period_s;
    const double longer = std::max(0.0, 1.5 * found.design.loop.modes.settling_s - 3);
    const double ticks = std::ceil(std::min(60.0, scenario.loop.duration_s + longer) / h);
    gains.push_back(fmt::format("loop.duration_s={:.12g}", ticks * h));
    std::string text = "# Assumptions, with the key that changes each:\n";
    for (const std::string& each : found.assumed) text += "# - " + each + "\n";
    return (found.assumed.empty() ? "" : text) + designed().text;
  }
};

}  // namespace

const Verb design_verb = verb_of<Design>(
    "design",
    "Computes gains that keep a stability margin, for a scenario's law or for a URDF alone",
    "  tachless design scenarios/practical_rigid.yaml --settling 0.2\n"
    "  tachless design arm.yaml --controller ./own_law --write tuned.yaml\n"
    "  tachless design robot.urdf --bandwidth 3 --write robot.yaml && tachless run robot.yaml");

}  // namespace tachless::cli

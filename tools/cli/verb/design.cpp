// The verb design.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
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
#include "design/design.h"
#include "design/structure.h"
#include "robot/urdf_xml.h"
#include "scenario/scenario.h"
#include "session/options.h"

namespace tachless::cli {
namespace {

namespace fs = std::filesystem;
using base::ExitCode;
using design::Structure;

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
  json["objections"] = design.objections;
  json["reached"] = !design.missed;
  return json;
}

struct Design {
  fs::path input;
  std::vector<std::string> overrides;
  design::DesignGoal goal;
  std::vector<double> stiffness, rest_error, from;
  double period_s = 0;
  std::string structure, law_program;  ///< structure: empty where none is given
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
                    "constant matrix for all postures, or _scheduled, with M(q_ref). auto compares "
                    "diagonal and scheduled gains. Default: auto for a URDF, else the scenario's "
                    "law")
        ->check(CLI::IsMember({"auto", "diagonal", "matrix", "scheduled"}));
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
    require_scenario_writable(output, force);
    Screen screen(quiet);
    Found found = compares() ? chosen(screen) : own(screen);
    screen.clear();
    const scenario::Scenario& scenario = found.designed.scenario;
    const design::Design& design = found.designed.design;
    nlohmann::ordered_json all = to_json(design, scenario);
    if (!found.structures.empty()) all["structures"] = found.structures;
    if (!found.assumed.empty()) all["assumes"] = found.assumed;
    print(json, std::move(all), found.text + text(design, scenario));
    for (const std::string& warning : design.warnings) base::log_warning(warning);
    for (const std::string& objection : design.objections) base::log_error(objection);
    if (!design.objections.empty()) {
      base::log_error("{}: nobody can use these gains{}; {}", input.string(),
                      output.empty() ? "" : ", nothing is written", ways_out(scenario));
      return ExitCode::check_said_no;
    }
    if (design.missed) {
      base::log_error("{}: settles in {}, not in {:g} s: limited by {}{}", input.string(),
                      certify::settling_text(design.loop.modes.settling_s), *design.missed,
                      design.binds.empty() ? "the law" : design.binds.front(),
                      output.empty() ? "" : "; nothing is written");
      return ExitCode::check_said_no;
    }
    if (!output.empty()) {
      base::UnfinishedFile(output, write_remedy).write(designed_text(found.designed));
      if (!json) {
        std::cout << fmt::format(
            "  type: tachless run {}{}\n", base::shell_word(output.string()),
            law_program.empty() ? "" : " --controller " + base::shell_word(law_program));
      }
    }
    return ExitCode::done;
  }

 private:
  struct Designed {
    scenario::Scenario scenario;
    design::Design design;
  };
  struct Found {
    Designed designed;
    std::string text;                   ///< that stands before the design's own
    nlohmann::ordered_json structures;  ///< what was compared; empty: nothing
    std::vector<std::string> assumed;
  };

  /// Returns true if structures are compared.
  [[nodiscard]] bool compares() const {
    if (!structure.empty()) return structure == "auto";
    const bool names_a_law = std::ranges::any_of(overrides, [](const std::string& each) {
      return each.starts_with("controller.law=") || each.starts_with("controller=");
    });
    return law_program.empty() && !names_a_law && bare_urdf();
  }

  /// Designs the gains of the structure asked for, or of the scenario's own law.
  [[nodiscard]] Found own(Screen& screen) const {
    scenario::Scenario scenario = load(structure, of_program(input, overrides, law_program));
    warn(scenario);
    design::Design found = design::design(scenario, whole_goal(scenario.num_joints),
                                          progress(screen, ""), law_answers(scenario, law_program));
    std::vector<std::string> assumed = assumptions(scenario);
    std::string before = text_of(assumed);
    return {{std::move(scenario), std::move(found)}, std::move(before), {}, std::move(assumed)};
  }

  /// Designs diagonal and scheduled gains, and chooses.
  [[nodiscard]] Found chosen(Screen& screen) const {
    std::vector<design::Candidate> candidates;
    std::vector<scenario::Scenario> scenarios;
    for (const Structure each : {Structure::diagonal, Structure::scheduled}) {
      const std::string name(base::name_of(each));
      scenarios.push_back(load(name, {}));
      if (candidates.empty()) warn(scenarios.back());
      design::DesignGoal wanted = whole_goal(scenarios.back().num_joints);
      if (each == Structure::scheduled && !wanted.bandwidth_hz) {
        wanted.bandwidth_hz = design::default_bandwidth_hz;
      }
      candidates.push_back({each, {}, {}});
      try {
        candidates.back().design =
            design::design(scenarios.back(), wanted, progress(screen, name + " gains: "));
      } catch (const base::Failure& failure) {
        if (failure.code() != ExitCode::check_said_no) throw;
        candidates.back().refusal = failure.what();
      }
    }
    const auto [best, reason] =
        design::choose(candidates, goal, !stiffness.empty() || !rest_error.empty());
    std::vector<std::string> assumed = assumptions(scenarios[best]);
    std::string before = text_of(assumed) + comparison_text(candidates, best, reason);
    nlohmann::ordered_json compared = comparison_json(candidates, best, reason);
    return {{std::move(scenarios[best]), std::move(*candidates[best].design)},
            std::move(before),
            std::move(compared),
            std::move(assumed)};
  }

  /// Returns what makes gains stiffer.
  [[nodiscard]] std::string ways_out(const scenario::Scenario& scenario) const {
    std::vector<std::string> ways;
    if (scenario.robot.rigid_rotor_inertia_kgm2.isZero(0)) {
      ways.emplace_back("give the rotors' inertia (--set robot.joint_parameters=FILE)");
    }
    if (scenario.controller.law != design::law_of(Structure::scheduled)) {
      ways.emplace_back("take --structure scheduled");
    }
    ways.emplace_back("give finer encoders (--set plant.encoder.resolution_bits=BITS)");
    const robot::Model& model = *scenario.model;
    for (std::size_t j = 0; j < model.joint_names.size(); ++j) {
      const auto i = static_cast<Eigen::Index>(j);
      const bool finger = model.joint_types[j] == robot::JointType::prismatic &&
                          model.upper[i] - model.lower[i] < 0.1;
      if (!finger) continue;
      ways.push_back(fmt::format("lock the finger (--set 'robot.locked={{{}: {:g}}}')",
                                 model.joint_names[j], 0.5 * (model.lower[i] + model.upper[i])));
    }
    return base::joined(ways, ", or ");
  }

  [[nodiscard]] static linear::OnProgress progress(Screen& screen, const std::string& of) {
    return [&screen, of](std::string_view what) { screen.show(of + std::string(what)); };
  }

  /// Returns what a scenario of a bare URDF has that neither URDF nor options state, with the key
  /// that changes it.
  [[nodiscard]] std::vector<std::string> assumptions(const scenario::Scenario& scenario) const {
    std::vector<std::string> assumed;
    if (!bare_urdf()) return assumed;
    const auto given = [&](const char* key) {
      return std::ranges::any_of(overrides,
                                 [&](const std::string& each) { return each.starts_with(key); });
    };
    const auto assume = [&](const char* key, const std::string& what) {
      if (!given(key)) assumed.push_back(fmt::format("{} ({})", what, key));
    };
    if (const auto& bits = scenario.plant.encoder.resolution_bits; bits && bits->size() > 0) {
      assume("plant.encoder.resolution_bits", fmt::format("encoders of {:g} bits", (*bits)[0]));
    }
    assume("loop.command_delay", fmt::format("{} tick of delay", scenario.loop.command_delay));
    if (scenario.robot.rigid_rotor_inertia_kgm2.isZero(0)) {
      assume(
          "robot.joint_parameters",
          "rotors of inertia 0, as the URDF has none: with a real arm's, gains are 2 to 20 times "
          "stiffer");
    }
    const plant::DriveSpec& drive = scenario.plant.drive;
    const bool rubs =
        !drive.viscous_friction_Nms_per_rad.isZero(0) || !drive.coulomb_friction_Nm.isZero(0);
    assume("plant.drive.coulomb_friction_Nm",
           rubs ? "the URDF's friction" : "no friction, as the URDF has none");
    assume("plant.drive.torque_limit_Nm",
           drive.torque_limit_Nm ? "the URDF's effort limits" : "no torque limits");
    return assumed;
  }

  [[nodiscard]] static std::string text_of(const std::vector<std::string>& assumed) {
    std::string text;
    for (const std::string& each : assumed) {
      text += (text.empty() ? "assumes   " : "          ") + each + "\n";
    }
    return text;
  }

  /// Returns "3.3 to 3330", or one number where all are equal.
  [[nodiscard]] static std::string range_text(const Eigen::VectorXd& values) {
    if (values.size() == 0) return "-";
    const double least = values.minCoeff(), most = values.maxCoeff();
    return least == most ? fmt::format("{:.3g}", least)
                         : fmt::format("{:.3g} to {:.3g}", least, most);
  }

  [[nodiscard]] static std::string comparison_text(const std::vector<design::Candidate>& candidates,
                                                   std::size_t best, const std::string& reason) {
    std::vector<std::vector<std::string>> rows = {
        {"gains", "settle in", "stiffness", "F_c/kp", "torque of a count", "modulus in range", ""}};
    std::string refusals;
    for (std::size_t k = 0; k < candidates.size(); ++k) {
      const design::Candidate& each = candidates[k];
      const std::string name(base::name_of(each.structure));
      if (!each.design) {
        rows.push_back({name, "none found"});
        refusals += fmt::format("  {}: {}\n", name, each.refusal);
        continue;
      }
      const certify::Prediction& loop = each.design->loop;
      rows.push_back(
          {name, certify::settling_text(loop.modes.settling_s),
           range_text(loop.stiffness) + " " + std::string(loop.stiffness_unit),
           range_text(loop.rest_error),
           loop.count_Nm ? range_text(*loop.count_Nm) + " " + std::string(loop.torque_unit) : "-",
           fmt::format("{:.2f}", each.design->modulus_in_range), k == best ? "<- taken" : ""});
    }
    const char* const other =
        candidates[best].structure == Structure::scheduled ? "diagonal" : "scheduled";
    return base::table(rows, "l") + refusals +
           fmt::format("  {}; --structure {} gives the others\n", reason, other);
  }

  [[nodiscard]] static nlohmann::ordered_json comparison_json(
      const std::vector<design::Candidate>& candidates, std::size_t best,
      const std::string& reason) {
    const auto list = [](const Eigen::VectorXd& v) {
      return std::vector<double>(v.begin(), v.end());
    };
    nlohmann::ordered_json all = nlohmann::ordered_json::array();
    for (std::size_t k = 0; k < candidates.size(); ++k) {
      const design::Candidate& each = candidates[k];
      nlohmann::ordered_json row = {{"structure", base::name_of(each.structure)},
                                    {"law", design::law_of(each.structure)},
                                    {"taken", k == best}};
      if (each.design) {
        row["settling_s"] = each.design->loop.modes.settling_s;
        row["stiffness"] = list(each.design->loop.stiffness);
        row["rest_error"] = list(each.design->loop.rest_error);
        if (each.design->loop.count_Nm) row["count_torque_Nm"] = list(*each.design->loop.count_Nm);
        row["modulus_in_range"] = each.design->modulus_in_range;
      } else {
        row["refusal"] = each.refusal;
      }
      if (k == best) row["reason"] = reason;
      all.push_back(std::move(row));
    }
    return all;
  }

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

  /// Returns the scenario, or that of a bare URDF, with these overrides.
  /// @param with the structure of its gains; empty: those of its own law
  [[nodiscard]] scenario::Scenario load(const std::string& with,
                                        std::vector<std::string> more) const {
    if (period_s > 0) more.push_back(fmt::format("loop.period_s={}", period_s));
    if (!with.empty()) {
      const std::string_view law = design::law_of(*base::value_of<Structure>(with));
      more.insert(more.begin(), {"controller.gains={}", fmt::format("controller.law={}", law)});
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
    return scenario::parse_scenario(scenario, urdf, input.string(), more, fs::path());
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

  /// Returns the scenario with the design's gains, as text.
  [[nodiscard]] std::string designed_text(const Designed& found) const {
    const scenario::Scenario& scenario = found.scenario;
    const design::Design& design = found.design;
    std::vector<std::string> gains = design::overrides_of(design);
    // The files were read before the search: they may have changed since.
    const auto designed = [&] {
      if (!law_program.empty()) return load("", std::move(gains));
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

const Verb design_verb = verb_of<Design>(
    "design", "Gains that keep a margin, for a scenario's law or for a bare URDF",
    "  tachless design scenarios/practical_rigid.yaml --settling 0.2\n"
    "  tachless design arm.yaml --controller ./own_law --write tuned.yaml\n"
    "  tachless design robot.urdf --bandwidth 3 --write robot.yaml && tachless run robot.yaml");

}  // namespace tachless::cli

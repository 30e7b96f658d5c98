// The verbs on a robot's own parameters: excite, identify.

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

#include "base/file_text.h"
#include "base/logging.h"
#include "base/text.h"
#include "certify/certify.h"
#include "cli/progress.h"
#include "cli/verb.h"
#include "identify/excite.h"
#include "identify/identify.h"
#include "logger/log_file.h"
#include "numerics/decompositions.h"
#include "robot/dynamics.h"
#include "scenario/description.h"
#include "scenario/drive_loop.h"
#include "scenario/scenario.h"
#include "scenario/yaml_tree.h"
#include "session/options.h"

namespace tachless::cli {

namespace {

namespace fs = std::filesystem;
using base::ExitCode;
using identify::Recording;
using identify::TorqueSource;

Recording read(const fs::path& log, TorqueSource source) {
  if (is_yaml(log)) {
    if (source == TorqueSource::commanded) return identify::read_table(log);
    throw base::bad_usage("--torque {}: {} is a table, whose file names the column of torques",
                          base::name_of(source), log.string());
  }
  Recording recording = identify::read_recording(logger::find_log(log), source);
  scenario::require_no_drive_loop(
      recording.scenario, "the log has the host's torques, identify needs the sums of the drives");
  return recording;
}

/// Declares --unknown, which takes the first `count` kinds.
CLI::Option* add_unknown(CLI::App& command, std::vector<std::string>& unknown, std::size_t count) {
  const std::vector<std::string> known(identify::kind_names.begin(),
                                       identify::kind_names.begin() + static_cast<long>(count));
  return command.add_option("--unknown", unknown, "Of " + base::joined(known))
      ->delimiter(',')
      ->default_str("rotor,viscous,coulomb")
      ->check(CLI::IsMember(known));
}

std::vector<identify::Kind> kinds(const std::vector<std::string>& unknown) {
  std::vector<identify::Kind> result;
  for (std::size_t i = 0; i < identify::kind_names.size(); ++i) {
    if (std::ranges::find(unknown, identify::kind_names[i]) != unknown.end()) {
      result.push_back(static_cast<identify::Kind>(i));
    }
  }
  return result;
}

struct Excite {
  fs::path input, output;
  std::vector<std::string> overrides, unknown = {"rotor", "viscous", "coulomb"};
  identify::ExcitationGoal goal;
  bool all = false, force = false, quiet = false;

  void declare(CLI::App& command) {
    session::with_installed_scenarios(session::add_scenario(command, input, overrides));
    CLI::Option* const chosen = add_unknown(command, unknown, identify::num_motion_kinds);
    command.add_flag("--all", all, "Unknown: rotor, viscous, coulomb and inertia of all links")
        ->excludes(chosen);
    command.add_option("--duration", goal.duration_s, "Duration of the motion [s]; default: 20")
        ->check(CLI::Range(5.0, 60.0));
    command
        .add_option("--reach", goal.reach,
                    "Largest distance of a joint from its start [rad; m]; default: 0.5")
        ->check(CLI::Range(0.02, 3.0));
    command.add_option("--floor", goal.floor,
                       "Least height of the links' origins above the base's origin [m]");
    command
        .add_option("--clearance", goal.clearance,
                    "Least distance of links that no joint connects, by the primitive shapes of "
                    "the URDF [m]; default: 0.02")
        ->check(CLI::Range(0.0, 1.0));
    command.add_option("--write", output, "The scenario with this motion, as a file")->required();
    command.add_flag("--force", force, "Replace that file if it exists");
    add_quiet(command, quiet);
  }

  [[nodiscard]] ExitCode run() const {
    require_scenario_writable(output, force);
    const scenario::Scenario scenario = scenario::load_scenario(input, overrides);
    identify::ExcitationGoal wanted = goal;
    wanted.shapes = scenario::read_description(
                        fs::path(scenario.source).parent_path() / scenario.robot.urdf_path,
                        scenario.robot.xacro)
                        .urdf;
    Screen screen(quiet);
    const auto show = [&](std::string_view what) { screen.show(fmt::format("excite: {}", what)); };
    std::vector<std::string> sought = unknown;
    if (all) sought.emplace_back("inertia");
    const identify::Excitation found = identify::excite(scenario, kinds(sought), wanted, show);
    std::vector<std::string> changes = overrides;
    changes.insert(changes.end(), found.overrides.begin(), found.overrides.end());
    changes.push_back("name=" + scenario_name(output));
    const scenario::Scenario moving = scenario::load_scenario(input, changes);
    const std::vector<std::string> objections =
        certify::objections(certify::certify(moving, {.tell = show}));
    screen.clear();
    print_text(text(found));
    for (const std::string& objection : objections) {
      base::log_error("{}: {}; nothing written", input.string(), objection);
    }
    if (!objections.empty()) return ExitCode::check_said_no;
    write_scenario(input, overrides, found.overrides, output);
    std::cout << fmt::format("  type: tachless run {}\n", base::shell_word(output.string()));
    return ExitCode::done;
  }

 private:
  [[nodiscard]] std::string text(const identify::Excitation& found) const {
    std::string text = fmt::format(
        "{}: condition number {:.3g}; within [{:.2g}] rad (m), [{:.2g}] rad/s (m/s), [{:.3g}] N m "
        "(N)\n"
        "  predicted 95 % intervals, with torque noise of {:g} % of the limit\n",
        output.string(), found.condition, fmt::join(found.reach, ", "),
        fmt::join(found.speed, ", "), fmt::join(found.torque, ", "), 100 * identify::noise_share);
    for (const auto& [name, unit, half_width] : found.widths) {
      text += std::isfinite(half_width)
                  ? fmt::format("  {:<24} +- {:.2g} {}\n", name, half_width, unit)
                  : fmt::format("  {:<24} only in sums with others\n", name);
    }
    if (const auto& pair = found.nearest) {
      text += fmt::format("  the nearest links that no joint connects: {} and {}, {:.3g} m\n",
                          pair->a, pair->b, pair->distance);
    }
    for (const auto& pair : found.not_compared) {
      text += fmt::format("  not kept apart, since their shapes meet at the start: {} and {}\n",
                          pair.a, pair.b);
    }
    return text;
  }
};

/// Returns the option with which `design` keeps the margin for the rotors' 95 % intervals, with a
/// space before it. Returns nothing if all intervals are narrower than the digits of a margin.
std::string uncertain_option(const identify::Identified& found,
                             const scenario::Scenario& scenario) {
  constexpr double narrow = 0.01;  // of the joint's inertia with the other joints free
  const Vector free_inertia =
      numerics::inverse(robot::mass_matrix(*scenario.model, scenario.plant.initial.position_rad))
          .diagonal()
          .cwiseInverse();
  Vector half_width = Vector::Zero(scenario.num_joints);
  bool wide = false;
  for (const auto& each : found.parameters) {
    if (each.entry.kind != identify::Kind::rotor || !each.doubt.empty()) continue;
    half_width[each.entry.joint] = each.half_width;
    wide = wide || each.half_width > narrow * (free_inertia[each.entry.joint] + each.value);
  }
  if (!wide) return "";
  return fmt::format(" --uncertain rotors={:.2g}",
                     fmt::join(half_width.begin(), half_width.end(), "/"));
}

struct Identify {
  std::vector<fs::path> logs;
  std::vector<std::string> unknown = {"rotor", "viscous", "coulomb"};
  std::vector<fs::path> without;
  std::string carrier, torque{base::name_of(TorqueSource::commanded)};
  fs::path validate, output;
  bool all = false, force = false, json = false, quiet = false;
  CLI::Option* chosen = nullptr;  ///< --unknown

  void declare(CLI::App& command) {
    command
        .add_option("LOG", logs,
                    "Logs of runs of one robot, or their directories; or YAML files that say what "
                    "the columns of another logger's tables are")
        ->required();
    chosen = add_unknown(command, unknown, identify::num_asked_kinds);
    command
        .add_flag("--all", all,
                  "Unknown: everything; rotor, viscous, coulomb, inertia of all links, offset, and "
                  "a table's delay")
        ->excludes(chosen);
    command.add_option("--on", carrier,
                       "Link that carries a payload of unknown mass, centre and inertia");
    command.add_option("--without", without, "Logs of runs without this payload")->needs("--on");
    constexpr auto sources = names(TorqueSource());
    command
        .add_option("--torque", torque,
                    "Torques of a log: commanded, or what the arm told: accepted, measured by its "
                    "motors, or measured behind_gear by its joints' sensors")
        ->check(CLI::IsMember(std::vector<std::string>(sources.begin(), sources.end())));
    command.add_option("--validate", validate, "A log that is not used, to check the result with");
    command.add_option("--write", output,
                       "The log's scenario with the result, as F.yaml, and its URDF beside it");
    command.add_flag("--force", force, "Replace these files if they exist");
    add_json(command, json);
    add_quiet(command, quiet);
  }

  [[nodiscard]] ExitCode run() const {
    const fs::path urdf = fs::path(output).replace_extension(".urdf");
    require_scenario_writable(output, force);
    if (!output.empty()) require_writable(urdf, force);
    std::vector<Recording> recordings;
    std::optional<Recording> other;
    if (!validate.empty()) other = read_loaded(validate);
    for (std::size_t i = 0; i < logs.size() + without.size(); ++i) {
      const bool loaded = i < logs.size();
      recordings.push_back(read_loaded(loaded ? logs[i] : without[i - logs.size()]));
      recordings.back().loaded = loaded;
      std::error_code error;  // a file may have several names
      if (!other || !fs::equivalent(other->source, recordings.back().source, error)) continue;
      throw base::bad_usage("--validate {}: is one of the fitted logs; allowed: another log",
                            validate.string());
    }
    const scenario::Scenario& scenario = recordings.front().scenario;
    if (!output.empty() && scenario.believed_model) {
      throw base::bad_usage(
          "{}: has controller.urdf, which --write cannot carry over; leave --write out",
          recordings.front().source);
    }
    Screen screen(quiet);
    const std::vector<std::string> everything = {"rotor", "viscous", "coulomb", "inertia",
                                                 "offset"};
    std::vector<std::string> sought = all ? everything : unknown;
    if (!chosen->count() && !recordings.front().controlled) sought.emplace_back("delay");
    if (!carrier.empty()) std::erase(sought, "payload");
    if (source() == TorqueSource::behind_gear) keep_to_links(sought);
    std::vector<identify::Kind> unknown_kinds = kinds(sought);
    if (!carrier.empty()) unknown_kinds.push_back(identify::Kind::load);
    const identify::Identified found = identify::identify(
        recordings, unknown_kinds, other,
        [&](std::string_view what) { screen.show(fmt::format("identify: {}", what)); });
    screen.clear();
    print(json, found,
          identify::text(found, scenario.name) + torque_text() + missed_text(recordings));
    if (!found.no_fit.empty()) {
      base::log_error("{}: {}{}", recordings.front().source, found.no_fit,
                      output.empty() ? "" : "; nothing written");
      return ExitCode::check_said_no;
    }
    bool whole = true;
    for (const auto& each : found.parameters) {
      whole = whole && (each.doubt.empty() || each.in_sum);
    }
    if (!whole) {
      base::log_error(
          "{}: not every parameter is identifiable{}; record {}, or leave one out of --unknown",
          recordings.front().source, output.empty() ? "" : ": nothing written",
          fmt::join(found.advice, "; "));
      return ExitCode::check_said_no;
    }
    if (!output.empty()) write(scenario, found, urdf);
    return ExitCode::done;
  }

 private:
  [[nodiscard]] TorqueSource source() const { return *base::value_of<TorqueSource>(torque); }

  /// Leaves out the kinds that sensors behind the gears do not see.
  /// @throw base::Failure(bad_usage) if nothing is left, or if --unknown asks for one of them
  void keep_to_links(std::vector<std::string>& sought) const {
    for (const char* kind : {"rotor", "viscous", "coulomb"}) {
      const auto unseen = std::erase(sought, kind);
      if (unseen > 0 && chosen->count() > 0) {
        throw base::bad_usage(
            "--unknown {}: sensors behind the gears do not see it; allowed with --torque "
            "behind_gear: payload, delay, inertia, offset",
            kind);
      }
    }
    if (!carrier.empty() || std::ranges::find(sought, "inertia") != sought.end() ||
        chosen->count() > 0) {
      return;
    }
    throw base::bad_usage(
        "--torque behind_gear: name what is unknown: --unknown inertia, payload or offset, --all "
        "or --on LINK");
  }

  /// Returns a line that names the torques; nothing for commanded ones.
  [[nodiscard]] std::string torque_text() const {
    switch (source()) {
      case TorqueSource::commanded:
        break;
      case TorqueSource::accepted:
        return "  torques: those that the arm accepted; least squares, the loop is not simulated\n";
      case TorqueSource::measured:
        return "  torques: those that the arm measured, taken for its motors' (of sensors behind "
               "the gears: --torque behind_gear); least squares, the loop is not simulated\n";
      case TorqueSource::behind_gear:
        return "  torques: those of the sensors behind the gears, without rotors and friction; "
               "least squares, the loop is not simulated\n";
    }
    return "";
  }

  /// Returns a line about missed ticks of logs; nothing if there are none.
  [[nodiscard]] static std::string missed_text(const std::vector<Recording>& recordings) {
    std::string text;
    for (const Recording& each : recordings) {
      if (each.missed == 0) continue;
      text += fmt::format(
          "  {}: {} of {} ticks were missed; least squares, the loop is not simulated\n",
          each.source, each.missed, each.num_ticks());
    }
    return text;
  }

  /// Reads a recording whose payload, if it is asked for, is on the link of --on.
  [[nodiscard]] Recording read_loaded(const fs::path& log) const {
    Recording recording = read(log, source());
    if (carrier.empty()) return recording;
    try {
      robot::with_payload(*recording.scenario.model, {}, carrier);
    } catch (const std::invalid_argument& refused) {
      throw base::bad_usage("--on {}: {}", carrier, refused.what());
    }
    recording.scenario.plant.payload = {.link = carrier};
    return recording;
  }

  void write(const scenario::Scenario& scenario, const identify::Identified& found,
             const fs::path& urdf) const {
    std::vector<std::string> overrides = found.overrides;
    overrides.push_back("name=" + scenario_name(output));
    overrides.push_back(scenario::text_override("robot.urdf", urdf.filename().string()));
    if (!scenario.robot.xacro.empty()) overrides.emplace_back("robot.xacro={}");
    const std::string corrected = identify::urdf_of(found, scenario);
    const std::string text =
        scenario::parse_scenario(scenario.text, corrected, logs.front().string(), overrides).text;
    base::UnfinishedFile(urdf, write_remedy).write(corrected);
    base::UnfinishedFile(output, write_remedy).write(text);
    if (json) return;
    std::cout << fmt::format("  type: tachless design {}{}\n", base::shell_word(output.string()),
                             uncertain_option(found, scenario));
  }
};

}  // namespace

const Verb excite_verb = verb_of<Excite>(
    "excite", "Designs a motion from which identify finds a robot's rotor inertia and friction",
    "  tachless excite arm.yaml --write move.yaml && tachless run move.yaml --out out/move\n"
    "  tachless identify out/move --write known.yaml");

const Verb identify_verb = verb_of<Identify>(
    "identify", "Estimates rotor inertia, friction and payload from logs of a robot's own runs",
    "  tachless identify out/arm\n"
    "  tachless identify out/arm --unknown rotor,viscous,coulomb,payload --validate out/other "
    "--write known.yaml && tachless design known.yaml");

}  // namespace tachless::cli

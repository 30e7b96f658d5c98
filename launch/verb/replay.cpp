#include "replay/replay.h"

#include <fmt/core.h>

#include <chrono>
#include <iostream>
#include <memory>
#include <optional>

#include "controller/law_socket.h"
#include "diagnostics/json_text.h"
#include "diagnostics/logging.h"
#include "launch/verb.h"
#include "robot/joint_labels.h"

namespace tachless::launch::verb {
namespace {

using diagnostics::ExitCode;
using Json = nlohmann::ordered_json;

struct Options {
  std::filesystem::path log;
  std::int64_t run = 0;
  std::string law;
  std::string law_program;
  std::vector<std::string> overrides;
  std::filesystem::path out;
  bool json = false;

  [[nodiscard]] controller::MakeLaw make_law() const {
    if (law_program.empty()) return controller::scenario_law;
    return [this](const experiment::Scenario& scenario) {
      return controller::external_law(scenario, law_program);
    };
  }
};

/// What has to be set for the law that is asked for, in place of the recorded one.
std::vector<std::string> changes(const Options& options, const logger::RunLog& log) {
  std::vector<std::string> all = options.overrides;
  if (!options.law.empty()) all.push_back("controller.law=" + options.law);
  const std::string& recorded = log.scenario().controller.law;
  if (!options.law_program.empty() && recorded != experiment::external_law) {
    all.push_back(fmt::format("controller.law={}", experiment::external_law));
    all.push_back("controller.measurement=" + log.info().measurement);
  }
  return all;
}

void warn_of_damage(const logger::RunLog& log) {
  const std::string damage = replay::damage_text(log);
  if (!damage.empty()) diagnostics::log_warning(damage);
}

ExitCode verify(const Options& options, logger::RunLog& log, const robot::JointLabels& joints) {
  const auto begun = std::chrono::steady_clock::now();
  const replay::Replay result =
      replay::replay(log, log.scenario(), options.make_law()(log.scenario()));
  const double wall_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
  const std::string problem = replay::problem_text(result, log, joints);
  warn_of_damage(log);
  if (options.json) {
    Json json = {{"log", log.path().string()},
                 {"run_id", log.run()},
                 {"law", log.scenario().controller.law_text()},
                 {"same", problem.empty()}};
    json.update(to_json(result));
    json["wall_s"] = wall_s;
    std::cout << diagnostics::json_text(json, 2) << "\n";
  } else if (problem.empty()) {
    std::cout << replay::verified_text(result, log, wall_s);
  }
  if (problem.empty()) return ExitCode::done;
  diagnostics::log_error(problem);
  return ExitCode::check_said_no;
}

ExitCode compare(const Options& options, const std::vector<std::string>& overrides,
                 logger::RunLog& log, const robot::JointLabels& joints) {
  const replay::Comparison comparison =
      replay::compare(log, overrides, options.make_law(), options.out, joints);
  const replay::Replay& result = comparison.replay;
  warn_of_damage(log);
  const std::string hindrance = replay::hindrance(result, log);
  if (!hindrance.empty()) {
    diagnostics::log_warning("{}: {}", log.path().string(), hindrance);
  }
  if (options.json) {
    Json json = {{"log", log.path().string()},
                 {"run_id", log.run()},
                 {"law", comparison.scenario.controller.law_text()},
                 {"set", overrides}};
    json.update(to_json(result));
    json["csv"] = comparison.csv.string();
    json["figure"] = result.compared > 0 ? Json(comparison.svg.string()) : Json();
    std::cout << diagnostics::json_text(json, 2) << "\n";
  } else if (result.compared > 0) {
    std::cout << replay::comparison_text(comparison, joints, log.info().period_s);
  }
  if (result.not_finite) return ExitCode::protective_stop;
  return result.compared > 0 ? ExitCode::done : ExitCode::check_said_no;
}

ExitCode run_replay(const Options& options) {
  logger::RunLog log = logger::RunLog::open(
      options.log, options.run == 0 ? std::nullopt : std::optional(options.run));
  const robot::JointLabels joints = robot::joint_labels(controller::rigid_model(log.scenario()));
  const std::vector<std::string> overrides = changes(options, log);
  return overrides.empty() ? verify(options, log, joints)
                           : compare(options, overrides, log, joints);
}

Verb::Action declare(CLI::App& command) {
  auto options = std::make_shared<Options>();
  with_directories(command.add_option("LOG", options->log, "The log of a run, or its directory"))
      ->required();
  command.add_option("--run-id", options->run, "Which run, where the log holds several");
  auto* law = command.add_option("--law", options->law, "What would this law have commanded?");
  command
      .add_option("--controller", options->law_program,
                  "The recorded law, or one in its place, is in this program, as typed in a shell; "
                  "it is given the recorded measurements and references")
      ->excludes(law);
  command
      .add_option("--set", options->overrides,
                  "key.path=value: what would have been commanded with it? May be repeated")
      ->allow_extra_args(false);
  command.add_option(
      "--out", options->out,
      "With --law or --set: where replay.svg and replay.csv go; default: beside the log");
  command.add_flag("--json", options->json, "As JSON");
  return [options] { return run_replay(*options); };
}

}  // namespace

extern const Verb replay;
const Verb replay = {
    "replay", "The controller again, on a log's own inputs: the same commands, bit for bit?",
    "  tachless replay out/paper_rigid/lcmlog\n"
    "  tachless replay out/paper_rigid/lcmlog --set 'controller.gains.kp=[400, 300]'\n"
    "  tachless replay out/paper_rigid --law numerical_difference --set 'controller.gains={kp: "
    "400, kd: 40, samples: 2}' --out out/what_if",
    declare};

}  // namespace tachless::launch::verb

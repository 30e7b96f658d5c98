#include "replay/replay.h"

#include <fmt/core.h>

#include <chrono>
#include <iostream>
#include <memory>
#include <optional>

#include "controller/registry.h"
#include "diagnostics/json_text.h"
#include "diagnostics/logging.h"
#include "launch/verb.h"
#include "replay/verdict.h"
#include "replay/what_if.h"
#include "robot/joint_labels.h"

namespace tachless::launch::verb {
namespace {

using diagnostics::ExitCode;
using Json = nlohmann::ordered_json;

struct Options {
  std::filesystem::path log;
  std::int64_t run = 0;
  std::string law;
  std::vector<std::string> overrides;
  std::filesystem::path out;
  bool json = false;

  [[nodiscard]] bool what_if() const { return !law.empty() || !overrides.empty(); }
};

void warn_of_damage(const logger::RunLog& log) {
  const std::string damage = replay::damage_text(log);
  if (!damage.empty()) diagnostics::log_warning(damage);
}

ExitCode verify(const Options& options, logger::RunLog& log, const robot::JointLabels& joints) {
  const auto begun = std::chrono::steady_clock::now();
  const replay::Replay result = replay::replay(log, log.scenario());
  const double wall_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
  const std::string problem = replay::problem_text(result, log, joints);
  warn_of_damage(log);
  if (options.json) {
    Json json = {{"log", log.path().string()},
                 {"run_id", log.run()},
                 {"law", log.scenario().controller.law},
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

ExitCode compare(const Options& options, logger::RunLog& log, const robot::JointLabels& joints) {
  const replay::Comparison comparison =
      replay::compare(log, options.law, options.overrides, options.out, joints);
  const replay::Replay& result = comparison.replay;
  warn_of_damage(log);
  const std::string hindrance = replay::hindrance(result, log);
  if (!hindrance.empty()) {
    diagnostics::log_warning(fmt::format("{}: {}", log.path().string(), hindrance));
  }
  if (options.json) {
    Json json = {{"log", log.path().string()},
                 {"run_id", log.run()},
                 {"law", comparison.scenario.controller.law},
                 {"set", options.overrides}};
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
  return options.what_if() ? compare(options, log, joints) : verify(options, log, joints);
}

Verb::Action declare(CLI::App& command) {
  auto options = std::make_shared<Options>();
  with_directories(command.add_option("LOG", options->log, "The log of a run, or its directory"))
      ->required();
  command.add_option("--run-id", options->run, "Which run, where the log holds several");
  command.add_option("--law", options->law, "What would this law have commanded?");
  command
      .add_option("--set", options->overrides,
                  "key.path=value: what would have been commanded with it? May be repeated")
      ->allow_extra_args(false);
  command.add_option("--out", options->out,
                     "With --law or --set: where replay.svg and replay.csv go; default: beside "
                     "the log");
  command.add_flag("--json", options->json, "As JSON");
  return [options] { return run_replay(*options); };
}

}  // namespace

extern const Verb replay;
const Verb replay = {
    "replay", "The controller again, on a log's own inputs: the same commands, bit for bit?",
    "  tachless replay out/paper_rigid/lcmlog\n"
    "  tachless replay out/paper_rigid/lcmlog --set 'controller.gains.kp=[400, 300]'\n"
    "  tachless replay out/paper_rigid --law numerical_difference "
    "--set 'controller.gains={kp: 400, kd: 40, samples: 2}' --out out/what_if",
    declare};

}  // namespace tachless::launch::verb

#include "replay/replay.h"

#include <chrono>
#include <cstdio>
#include <iostream>
#include <memory>
#include <optional>

#include "controller/registry.h"
#include "diagnostics/logging.h"
#include "launch/verb.h"
#include "replay/what_if.h"
#include "report/gnuplot.h"
#include "report/joint_units.h"

namespace tachless::launch::verb {
namespace {

struct Options {
  std::filesystem::path log;
  std::int64_t run = 0;
  std::string law;
  std::vector<std::string> overrides;
  std::filesystem::path out;
  bool json = false;

  [[nodiscard]] bool what_if() const { return !law.empty() || !overrides.empty(); }
};

std::string with_unit(double value, const std::string& unit) {
  char text[64];
  std::snprintf(text, sizeof text, "%.17g %s", value, unit.c_str());
  return text;
}

std::string describe(const replay::Mismatch& first, double period_s,
                     const report::JointUnits& units) {
  const std::string& unit = units.effort[static_cast<std::size_t>(first.joint)];
  char text[128];
  std::snprintf(text, sizeof text,
                "first at tick %lld (%.9g s), joint %d: ", static_cast<long long>(first.tick),
                static_cast<double>(first.tick) * period_s, first.joint + 1);
  std::string line = text;
  line += "recorded " + with_unit(first.recorded, unit) + ", replayed " +
          with_unit(first.replayed, unit);
  std::snprintf(text, sizeof text, ", %llu ulp%s or %.3g %s apart",
                static_cast<unsigned long long>(first.ulps), first.ulps == 1 ? "" : "s",
                first.replayed - first.recorded, unit.c_str());
  return line + text;
}

/// What hinders a full verdict; empty when nothing does.
std::string gap(const replay::Replay& replay, const logger::RunLog& log) {
  if (!replay.stopped_by.empty()) {
    return "cannot verify beyond " +
           (replay.compared > 0 ? "tick " + std::to_string(replay.last_compared) : "the start") +
           ": " + replay.stopped_by;
  }
  if (replay.without_command != 0) {
    return std::to_string(replay.without_command) + " ticks cannot be verified, the first is " +
           std::to_string(replay.first_without_command) + ": they have no " +
           log.summary().of(loop::Slot::command).channel;
  }
  if (replay.compared == 0) return "there is no tick whose command could be verified";
  return "";
}

void tell_damage(const logger::RunLog& log) {
  if (!log.damage().any()) return;
  diagnostics::log_warning(log.path().string() +
                           " is damaged: " + std::to_string(log.damage().bytes_skipped) +
                           " bytes at " + std::to_string(log.damage().stretches) +
                           " places are no events; see tachless info");
}

/// Of the keys of a scenario, those that a controller's commands depend on.
void require_of_controller(const std::vector<std::string>& overrides) {
  for (const std::string& setting : overrides) {
    if (setting.starts_with("controller.") || setting.starts_with("robot.") ||
        setting.starts_with("loop.command_delay")) {
      continue;
    }
    throw diagnostics::Failure(
        diagnostics::ExitCode::bad_usage,
        "--set " + setting +
            ": has no effect on a replay, which takes measurements and references "
            "from the log; allowed: controller.…, robot.…, loop.command_delay");
  }
}

diagnostics::ExitCode verdict(const Options& options, logger::RunLog& log,
                              const report::JointUnits& units) {
  const auto begun = std::chrono::steady_clock::now();
  const replay::Replay result = replay::replay(log, log.scenario());
  const double wall_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
  const double period_s = log.info().period_s;
  const double recorded_s = static_cast<double>(result.compared) * period_s;
  const std::string hindrance = gap(result, log);
  tell_damage(log);
  if (options.json) {
    nlohmann::ordered_json json = {{"log", log.path().string()},
                                   {"run_id", log.run()},
                                   {"law", log.scenario().controller.law},
                                   {"same", result.different == 0 && hindrance.empty()}};
    json.update(to_json(result));
    json["wall_s"] = wall_s;
    std::cout << json.dump(2) << "\n";
  }
  if (result.different != 0) {
    diagnostics::log_error(log.path().string() + ": " + std::to_string(result.different) + " of " +
                           std::to_string(result.compared) + " commands differ, " +
                           describe(*result.first, period_s, units) +
                           (hindrance.empty() ? "" : "; " + hindrance));
    return diagnostics::ExitCode::check_said_no;
  }
  if (!hindrance.empty()) {
    diagnostics::log_error(log.path().string() + ": " + hindrance + "; the " +
                           std::to_string(result.compared) + " commands verified are the same");
    return diagnostics::ExitCode::check_said_no;
  }
  if (!options.json) {
    std::printf("%s: run %lld, law %s\n", log.path().c_str(), static_cast<long long>(log.run()),
                log.scenario().controller.law.c_str());
    std::printf("the same: %lld commands, bit for bit", static_cast<long long>(result.compared));
    if (result.passed_over != 0) {
      std::printf("; %llu ticks have none, the controller passed them over",
                  static_cast<unsigned long long>(result.passed_over));
    }
    if (log.summary().last_tick + 1 != log.info().num_ticks) {
      std::printf(" (the run ended early: it was to have %lld ticks)",
                  static_cast<long long>(log.info().num_ticks));
    }
    std::printf("\n%.4g s of the robot's time in %.3g s: %.0f times as fast\n", recorded_s, wall_s,
                recorded_s / wall_s);
  }
  return diagnostics::ExitCode::done;
}

diagnostics::ExitCode what_if(const Options& options, logger::RunLog& log,
                              const report::JointUnits& units) {
  require_of_controller(options.overrides);
  std::vector<std::string> overrides = options.overrides;
  if (!options.law.empty()) overrides.push_back("controller.law=" + options.law);
  const experiment::Scenario scenario =
      experiment::parse_scenario(log.info().scenario, log.info().robot_description,
                                 log.path().string() + " (RUN_INFO)", overrides);
  const double period_s = log.info().period_s;
  const std::filesystem::path out = options.out.empty() ? log.path().parent_path() : options.out;
  std::error_code error;
  if (!out.empty()) std::filesystem::create_directories(out, error);
  const std::filesystem::path csv = out / "replay.csv";
  const std::filesystem::path svg = out / "replay.svg";

  controller::scenario_law(scenario);  // complains before files are made
  replay::WhatIf comparison(csv, period_s, units.effort);
  const replay::Replay result = replay::replay(
      log, scenario, [&](std::int64_t tick, const auto& recorded, const auto& replayed) {
        comparison.add(tick, recorded, replayed);
      });
  comparison.finish();
  const std::string title = log.scenario().name + ": recorded under " +
                            log.scenario().controller.law +
                            (scenario.controller.law == log.scenario().controller.law
                                 ? ", replayed with other settings"
                                 : ", replayed under " + scenario.controller.law);
  if (result.compared > 0) report::draw(comparison.figure(title, svg), svg);
  tell_damage(log);
  const std::string hindrance = gap(result, log);
  if (!hindrance.empty()) diagnostics::log_warning(log.path().string() + ": " + hindrance);

  if (options.json) {
    nlohmann::ordered_json json = {{"log", log.path().string()},
                                   {"run_id", log.run()},
                                   {"law", scenario.controller.law},
                                   {"set", options.overrides}};
    json.update(to_json(result));
    json["csv"] = csv.string();
    json["figure"] = result.compared > 0 ? nlohmann::json(svg.string()) : nlohmann::json();
    std::cout << json.dump(2) << "\n";
  } else if (result.compared > 0) {
    std::printf(
        "%s\n%lld ticks, %lld of them with another command\n\n%s\n  %s\n  %s\n", title.c_str(),
        static_cast<long long>(result.compared), static_cast<long long>(result.different),
        replay::what_if_table(result, units.effort, period_s).c_str(), svg.c_str(), csv.c_str());
  }
  if (result.not_finite) return diagnostics::ExitCode::protective_stop;
  return result.compared > 0 ? diagnostics::ExitCode::done : diagnostics::ExitCode::check_said_no;
}

diagnostics::ExitCode run_replay(const Options& options) {
  logger::RunLog log = logger::RunLog::open(
      options.log, options.run == 0 ? std::nullopt : std::optional(options.run));
  const report::JointUnits units = report::joint_units(controller::rigid_model(log.scenario()));
  return options.what_if() ? what_if(options, log, units) : verdict(options, log, units);
}

Verb::Action declare(CLI::App& command) {
  auto options = std::make_shared<Options>();
  command.add_option("LOG", options->log, "The log of a run")->required();
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
    "  tachless replay out/practical_rigid/lcmlog --law slotine_li --out out/what_if",
    declare};

}  // namespace tachless::launch::verb

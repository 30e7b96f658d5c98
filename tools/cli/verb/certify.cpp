// The verb certify.

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
#include "cli/mjcf_gains.h"
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

struct Certify {
  fs::path input;
  std::vector<std::string> overrides;
  fs::path witness;
  std::vector<double> errors = {0.3};
  std::string law_program;
  double period_s = 0;
  bool full = false, paper = false, force = false, json = false, quiet = false;

  void declare(CLI::App& command) {
    session::with_installed_scenarios(session::add_scenario(command, input, overrides))
        ->description("The experiment, a YAML file; or a MuJoCo model (MJCF)");
    command
        .add_option("--period", period_s,
                    "Step [s] of a MuJoCo model that is judged; default: its timestep")
        ->check(above_zero);
    command.add_option(
        "--witness", witness,
        "Also writes data from which check_witness.py proves a region of the sampled loop of one "
        "or "
        "two joints: share/tachless/witness/check_witness.py where tachless is installed, "
        "tools/cli/witness in the tree");
    auto* const error = command.add_option(
        "--witness-error", errors,
        "Error [rad] of one joint alone, from rest, that the region has to contain: one number, "
        "or one for each joint; default: 0.3");
    error->delimiter(',')->check(above_zero)->needs("--witness");
    command.add_flag("--force", force, "Replace the file of --witness if it exists")
        ->needs("--witness");
    command.add_option("--controller", law_program,
                       "Program with the law, as typed in a shell: 'python3 law.py'; the law's "
                       "answers to small deviations give its linear model");
    command.add_flag("--full", full,
                     "All numbers in place of five lines, and the searches that take seconds: the "
                     "nonlinear sampled loop, missed ticks in lockstep. With --json too");
    command.add_flag(
        "--paper", paper,
        "Also the conditions that Loria and Ortega (1995) print, with their constants");
    add_json(command, json);
    add_quiet(command, quiet);
  }

  [[nodiscard]] ExitCode run() const {
    if (const auto model = mjcf_file(input, overrides)) {
      if (full || paper || !witness.empty() || !law_program.empty()) {
        throw base::bad_usage(
            "{}: a MuJoCo model; --full, --paper, --witness and --controller need a scenario",
            input.string());
      }
      return check_mjcf_gains(input, *model, period_s, json);
    }
    if (period_s > 0) {
      throw base::bad_usage(
          "--period: only for a MuJoCo model; for a scenario type --set loop.period_s={}",
          period_s);
    }
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
    const auto show = [&](std::string_view what) { screen.show(fmt::format("certify: {}", what)); };
    const certify::Certificate result = certify::certify(
        scenario, {.full = full, .paper = paper, .answers = answers, .tell = show});
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

}  // namespace

const Verb certify_verb = verb_of<Certify>(
    "certify",
    "Checks the stability of a scenario's loop, with margins, or of a MuJoCo model's position "
    "actuators; runs nothing",
    "  tachless certify scenarios/paper_rigid.yaml\n"
    "  tachless certify scenarios/practical_rigid.yaml --set loop.period_s=0.002 "
    "--json\n"
    "  tachless certify scenarios/paper_rigid.yaml --full --paper\n"
    "  tachless certify panda.xml --period 0.001");

}  // namespace tachless::cli

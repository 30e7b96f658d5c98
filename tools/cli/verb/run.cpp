#include "cli/run.h"

#include <CLI/CLI.hpp>
#include <filesystem>
#include <vector>

#include "cli/verb.h"
#include "session/options.h"

namespace tachless::cli {
namespace {

struct Run : RunOptions {
  std::vector<std::filesystem::path> scenarios;

  void declare(CLI::App& command) {
    session::with_installed_scenarios(
        command.add_option("SCENARIO", scenarios,
                           "The experiment, a YAML file; several files: one robot each, on one "
                           "bus, and each option holds for all"))
        ->required();
    session::add_overrides(command, overrides);
    command.add_option(
        "--out", out,
        "Folder of log, summary and figure; default: out/NAME/DATE-TIME, with the link "
        "out/NAME/latest; with several robots, each has a folder in it with the robot's name");
    session::as_run_id(command.add_option(
        "--run-id", run_id, "Positive number in every message of the run; default: the time"));
    command
        .add_option("--mode", mode,
                    "lockstep: simulation time, as fast as possible; realtime: the wall clock")
        ->check(CLI::IsMember({"lockstep", "realtime"}));
    command.add_option("--duration", duration_s, "Length of the run [s]");
    session::add_lcm_url(command, lcm_url);
    session::add_key_file(command, key_file);
    command.add_option("--controller", law_program,
                       "The controller is this program, as typed in a shell: 'python3 law.py'; its "
                       "law gets the measurement of the scenario's law");
    auto* driver = command.add_option(
        "--plant", plant_program,
        "The plant is this program, as typed in a shell: a robot's driver, or in "
        "lockstep a simulator");
    command
        .add_flag("--dry-run", dry_run,
                  "Makes a whole run, but sends nothing to the robot of --plant")
        ->needs(driver);
    command
        .add_flag("--ramp", ramp,
                  "First bring the robot of --plant slowly from its present position to the "
                  "scenario's start, under the scenario's law")
        ->needs(driver)
        ->excludes(command.get_option("--dry-run"));
    command
        .add_option("--placement", placement,
                    "Placement on CPUs: auto (lockstep: plant, controller and reference on one "
                    "CPU) or none (the kernel chooses)")
        ->capture_default_str();
    command.add_flag(
        "--any-outcome", any_outcome,
        "Exit code 0 whatever the verdict: rests beside, saturated, oscillates, diverging");
    command.add_flag("--force", force, "Run even if the linearised loop is unstable");
    command.add_flag("--overwrite", overwrite, "Replace the results of an earlier run in --out");
    command.add_flag("--isolate", isolate,
                     "Run in a private network namespace; also TACHLESS_ISOLATE=1");
    command.add_flag("--watch", watch, "Show the run in a browser on this computer while it lasts");
    command
        .add_flag_callback("--realtime",
                           [] { throw base::bad_usage("--realtime: type --mode realtime"); })
        ->group("");
    command
        .add_flag_callback(
            "--visualize",
            [] { throw base::bad_usage("--visualize: the window is gone; type --watch"); })
        ->group("");
    auto* alone = command.add_flag(
        "--in-process", in_process,
        "The loop in one process, without a bus: the same log, two to three times as fast; with "
        "--set plant.mechanics=native more than ten times; lockstep only");
    // Not --lcm-url and --key-file, which the environment may give.
    for (const char* bus : {"--plant", "--isolate", "--placement", "--watch"}) {
      alone->excludes(command.get_option(bus));
    }
    auto* no_words = command.add_flag("-q,--quiet", quiet, "No progress and no table");
    command
        .add_flag("-v,--verbose", verbose,
                  "Shows how each of the four programs is set up, and why each of them ended")
        ->excludes(no_words);
    command.add_flag("--json", json, "The summary on stdout, instead of the table");
  }

  [[nodiscard]] base::ExitCode run() const {
    if (isolate && !plant_program.empty()) {
      throw base::bad_usage(
          "--isolate: with --plant the driver would be in the private network too, where it "
          "reaches "
          "no arm; leave one of the two out (a driver that needs no network: set "
          "TACHLESS_ISOLATE=1)");
    }
    return cli::run(*this, scenarios);
  }
};

}  // namespace

const Verb run_verb = verb_of<Run>(
    "run", "Runs an experiment: four processes, a log, a summary, a figure; or several on one bus",
    "  tachless run scenarios/paper_rigid.yaml\n"
    "  tachless run scenarios/paper_rigid.yaml --duration 0.5 --set 'controller.gains.kp=[400, "
    "300]'\n"
    "  tachless run scenarios/practical_rigid.yaml --mode realtime --out out/rt --isolate\n"
    "  tachless run scenarios/paper_rigid.yaml --controller 'python3 law.py'\n"
    "  tachless run arm.yaml --plant ./own_driver --mode realtime\n"
    "  tachless run arm.yaml --plant ./own_driver --ramp\n"
    "  tachless run left.yaml right.yaml");

}  // namespace tachless::cli

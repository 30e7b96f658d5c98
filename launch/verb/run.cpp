#include "launch/run_session.h"
#include "launch/verb.h"

#include <memory>

#include "node/options.h"

namespace tachless::launch::verb {
namespace {

Verb::Action declare(CLI::App& command) {
  auto options = std::make_shared<RunOptions>();
  auto scenarios = std::make_shared<std::vector<std::filesystem::path>>();
  node::with_installed_scenarios(
      command.add_option("SCENARIO", *scenarios,
                         "The experiment, a YAML file; several: a robot each, on one bus, and "
                         "every option is for all"))
      ->required();
  node::add_overrides(command, options->overrides);
  command.add_option("--out", options->out,
                     "Where log, summary and figure go; default: out/<the scenario's name>; of "
                     "several robots each into a folder there with its name, default: out. Files "
                     "of an earlier run are replaced once this one has begun");
  node::as_run_id(
      command.add_option("--run-id", options->run_id,
                         "Positive number in every message of the run; default: the time"));
  command
      .add_option("--mode", options->mode,
                  "lockstep: simulation time, as fast as it goes; realtime: the wall clock")
      ->check(CLI::IsMember({"lockstep", "realtime"}));
  command.add_option("--duration", options->duration_s, "Length of the run [s]");
  node::add_lcm_url(command, options->lcm_url);
  node::add_key_file(command, options->key_file);
  command.add_option("--controller", options->law_program,
                     "The controller is this program, as typed in a shell: 'python3 law.py'; its "
                     "law is fed with what the scenario's would be");
  command
      .add_option("--restart", options->restart,
                  "Start this process again when a signal kills it, 5 times at most; lockstep "
                  "only. The run goes on from its log, to the same result")
      ->check(CLI::IsMember({"controller"}));
  command
      .add_option("--placement", options->placement,
                  "On which CPUs: auto, spread, together (plant, controller and reference on one), "
                  "spin (on one each, never asleep), or numbers: one for all, two (these three, "
                  "logger) or four (plant,controller,reference,logger)")
      ->capture_default_str();
  command.add_flag(
      "--any-verdict", options->any_verdict,
      "Exit code 0 too when the run ends in a limit cycle, diverges or is mostly saturated");
  command.add_flag("--force", options->force,
                   "Run a loop too that is unstable at its period, as its linearisation shows");
  command.add_flag("--cross-check", options->cross_check,
                   "Before the run: step it in this process with Simbody's mechanics and with the "
                   "library's own, and end with code 1 if they differ");
  command.add_flag("--isolate", options->isolate,
                   "Run in a private network namespace; also TACHLESS_ISOLATE=1");
  auto* in_process = command.add_flag(
      "--in-process", options->in_process,
      "The loop in one process, without a bus: the same log, many times as fast; lockstep only");
  for (const char* bus : {"--lcm-url", "--key-file", "--restart", "--isolate", "--placement"}) {
    in_process->excludes(command.get_option(bus));
  }
  auto* visualize =
      command.add_flag("--visualize", options->visualize,
                       "Show the robot in Simbody's 3D window, at the simulated pace, to the end "
                       "of the motion; closing the window does not end the run");
  in_process->excludes(visualize);
  auto* quiet = command.add_flag("-q,--quiet", options->quiet, "No progress and no table");
  command
      .add_flag("-v,--verbose", options->verbose,
                "What each of the four programs works with, and why each of them ended")
      ->excludes(quiet);
  command.add_flag("--json", options->json, "The summary on stdout, instead of the table");
  return [options, scenarios] { return run_session(*options, *scenarios); };
}

}  // namespace

extern const Verb run;
const Verb run = {
    "run", "Run an experiment: four processes, a log, a summary, a figure; or several on one bus",
    "  tachless run scenarios/paper_rigid.yaml\n"
    "  tachless run scenarios/paper_rigid.yaml --duration 0.5 --set 'controller.gains.kp=[400, "
    "300]'\n"
    "  tachless run scenarios/practical_rigid.yaml --mode realtime --out out/rt --isolate\n"
    "  tachless run scenarios/iiwa_point_to_point.yaml --visualize\n"
    "  tachless run scenarios/paper_rigid.yaml --controller 'python3 law.py'\n"
    "  tachless run left.yaml right.yaml",
    declare};

}  // namespace tachless::launch::verb

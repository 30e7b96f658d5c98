#include "node/process_options.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <exception>
#include <iostream>

#include "diagnostics/version.h"
#include "node/options.h"

namespace tachless::node {
namespace {

const char* task(loop::Role role) {
  switch (role) {
    case loop::Role::plant:
      return "Simulates the robot of a scenario and keeps the loop's clock.";
    case loop::Role::reference:
      return "Generates the reference of a scenario, one tick ahead.";
    case loop::Role::controller:
      return "Runs the control law of a scenario.";
    case loop::Role::logger:
      return "Records the run of a scenario without a gap.";
  }
  throw std::logic_error("role " + std::to_string(static_cast<int>(role)) + " does not exist");
}

std::string examples(const std::string& program, loop::Role role) {
  std::string text = "Examples:\n  " + program + " scenarios/paper_rigid.yaml\n  " + program +
                     " scenarios/paper_rigid.yaml --set loop.duration_s=0.5 --lcm-url "
                     "'udpm://239.255.76.67:7700?ttl=0'\n";
  if (role == loop::Role::plant) {
    text += "  " + program + " scenarios/practical_rigid.yaml --run-id 7 --wait-s 10\n";
  }
  if (role == loop::Role::controller) {
    text += "  " + program + " scenarios/practical_rigid.yaml --follow 7\n  " + program +
            " scenarios/paper_rigid.yaml --resume out/paper_rigid/lcmlog\n";
  }
  if (role == loop::Role::logger) {
    text += "  " + program + " scenarios/practical_rigid.yaml --out-log out/lcmlog\n";
  }
  return text +
         "The four programs tachless-plant, tachless-reference, tachless-controller and\n"
         "tachless-logger may start in any order and must be given the same scenario.\n"
         "Exit codes: 0 done, 2 bad usage or scenario, 3 a peer is lost, 4 protocol violated,\n"
         "5 protective stop, 130 interrupted.";
}

std::string one_line(std::string text) {
  std::replace(text.begin(), text.end(), '\n', ' ');
  return text;
}

}  // namespace

std::string program_name(loop::Role role) {
  switch (role) {
    case loop::Role::plant:
      return "tachless-plant";
    case loop::Role::reference:
      return "tachless-reference";
    case loop::Role::controller:
      return "tachless-controller";
    case loop::Role::logger:
      return "tachless-logger";
  }
  throw std::logic_error("role " + std::to_string(static_cast<int>(role)) + " does not exist");
}

std::filesystem::path next_log_path(const std::filesystem::path& directory, const std::tm& date) {
  char day[32];
  std::strftime(day, sizeof day, "lcmlog-%Y-%m-%d", &date);
  for (int number = 0;; ++number) {
    char name[48];
    std::snprintf(name, sizeof name, "%s.%02d", day, number);
    std::filesystem::path path = directory / name;
    if (!std::filesystem::exists(path)) return path;
  }
}

std::optional<ProcessOptions> parse_process_options(loop::Role role, int argc,
                                                    const char* const* argv) {
  const std::string program = program_name(role);
  ProcessOptions options;
  options.lcm_url = default_lcm_url;
  std::int64_t run_id = 0;
  std::int64_t follow = 0;
  std::string resume;
  std::string stats_path;
  std::string key_path;
  std::string log_path;
  bool verbose = false;
  bool quiet = false;

  CLI::App cli(task(role), program);
  cli.footer(examples(program, role));
  cli.set_version_flag("--version", std::string(diagnostics::version),
                       "Print the version and exit");
  add_scenario(cli, options.scenario_path, options.overrides);
  add_lcm_url(cli, options.lcm_url);
  add_key_file(cli, key_path);
  cli.add_option("--wait-s", options.wait_s,
                 "Longest wait for the other programs at the start [s]; 0 = unlimited")
      ->check(CLI::Range(0.0, 1e6))
      ->capture_default_str();
  cli.add_option("--stats", stats_path, "Write counters to this file, as JSON, at the end");
  CLI::Option* run_id_option = nullptr;
  CLI::Option* follow_option = nullptr;
  if (role == loop::Role::plant) {
    run_id_option = add_run_id(cli, "--run-id", run_id,
                               "Positive number in every message of the run; default: the time");
  }
  if (role == loop::Role::controller) {
    follow_option =
        add_run_id(cli, "--follow", follow,
                   "Meet nobody: answer the measurements and references of this run, which "
                   "lcm-logplayer plays back; end with the run's last tick");
    cli.add_option("--resume", resume,
                   "Take the place of the lockstep run's controller, which has died: go through "
                   "the run's log, as far as it is, and on from there")
        ->excludes(follow_option);
  }
  if (role == loop::Role::logger) {
    cli.add_option("--out-log", log_path,
                   "The log; default: lcmlog-YYYY-MM-DD.NN here, with the next free NN");
  }
  auto* quiet_flag = cli.add_flag("-q,--quiet", quiet, "Warnings and errors only");
  cli.add_flag("-v,--verbose", verbose, "More detail on stderr")->excludes(quiet_flag);

  try {
    cli.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) {
      cli.exit(error, std::cout, std::cerr);
      return std::nullopt;
    }
    throw diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                               std::string(error.what()) + "; see " + program + " --help");
  }
  if (options.scenario_path.empty()) {
    throw diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                               "SCENARIO: empty; name a YAML file; see " + program + " --help");
  }
  if (!std::isfinite(options.wait_s)) {  // CLI::Range lets NaN through
    throw diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                               "--wait-s: not a number; allowed: 0 (unlimited) to 1e6 s");
  }
  if (run_id_option != nullptr && run_id_option->count() > 0) options.run_id = run_id;
  if (follow_option != nullptr && follow_option->count() > 0) options.follow = follow;
  if (!key_path.empty()) options.key_path = key_path;
  if (options.follow && options.key_path) {
    throw diagnostics::Failure(
        diagnostics::ExitCode::bad_usage,
        "--follow: what is played back does not verify under a key; unset --key-file "
        "and TACHLESS_KEY_FILE");
  }
  if (!resume.empty()) options.resume = resume;
  if (!stats_path.empty()) options.stats_path = stats_path;
  if (role == loop::Role::logger) {
    const std::time_t now = std::time(nullptr);
    std::tm date{};
    localtime_r(&now, &date);
    options.log_path = log_path.empty() ? next_log_path({}, date) : std::filesystem::path(log_path);
  }
  if (quiet) options.verbosity = diagnostics::Verbosity::quiet;
  if (verbose) options.verbosity = diagnostics::Verbosity::verbose;
  return options;
}

int run_process(loop::Role role, int argc, const char* const* argv,
                const std::function<diagnostics::ExitCode(const ProcessOptions&)>& run) {
  diagnostics::start_logging(program_name(role), diagnostics::Verbosity::normal);
  try {
    const std::optional<ProcessOptions> options = parse_process_options(role, argc, argv);
    if (!options) return static_cast<int>(diagnostics::ExitCode::done);
    diagnostics::start_logging(program_name(role), options->verbosity);
    return static_cast<int>(run(*options));
  } catch (const diagnostics::Failure& failure) {
    diagnostics::log_error(failure.what());
    return static_cast<int>(failure.code());
  } catch (const std::exception& error) {
    diagnostics::log_error("internal error: " + one_line(error.what()) +
                           "; please report it with the scenario and the options");
    return static_cast<int>(diagnostics::ExitCode::protocol_violated);
  }
}

}  // namespace tachless::node

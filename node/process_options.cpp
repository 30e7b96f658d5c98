#include "node/process_options.h"

#include <fmt/chrono.h>

#include <CLI/CLI.hpp>
#include <array>
#include <cmath>
#include <exception>

#include "diagnostics/failure.h"
#include "diagnostics/version.h"
#include "node/options.h"

namespace tachless::node {
namespace {

using diagnostics::ExitCode;
using diagnostics::Failure;

struct Program {
  const char* name;
  const char* task;
};

const Program& program_of(loop::Role role) {
  static constexpr std::array programs = {
      Program{"tachless-plant", "Simulates the robot of a scenario and keeps the loop's clock."},
      Program{"tachless-reference", "Generates the reference of a scenario, one tick ahead."},
      Program{"tachless-controller", "Runs the control law of a scenario."},
      Program{"tachless-logger", "Records the run of a scenario without a gap."}};
  return programs.at(static_cast<std::size_t>(role));
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

Failure bad_usage(const std::string& what) { return {ExitCode::bad_usage, what}; }

/// What CLI11 writes to, before it is known which options were given.
struct Given {
  std::int64_t run_id = 0;  // 0: not given; the options allow more only
  std::int64_t follow = 0;
  std::string resume;
  int serve = -1;
  std::string stats_path;
  std::string key_path;
  std::string log_path;
  bool verbose = false;
  bool quiet = false;
  bool mark_levels = false;
};

void add_role_options(CLI::App& cli, loop::Role role, Given& given) {
  if (role == loop::Role::plant) {
    add_run_id(cli, "--run-id", given.run_id,
               "Positive number in every message of the run; default: the time");
  }
  if (role == loop::Role::controller) {
    CLI::Option* follow =
        add_run_id(cli, "--follow", given.follow,
                   "Join nobody: answer the measurements and references of this run, which "
                   "lcm-logplayer plays back; end with the run's last tick");
    cli.add_option("--resume", given.resume,
                   "Take the place of the lockstep run's controller, which has died: go through "
                   "the run's log, as far as it is, and on from there")
        ->excludes(follow);
    // For `tachless replay` and `tachless run --in-process`; not in --help.
    cli.add_option("--serve", given.serve)->group("");
  }
  if (role == loop::Role::logger) {
    cli.add_option("--out-log", given.log_path,
                   "The log; default: lcmlog-YYYY-MM-DD.NN here, with the next free NN");
  }
}

void add_options(CLI::App& cli, loop::Role role, ProcessOptions& options, Given& given) {
  cli.footer(examples(program_name(role), role));
  cli.set_version_flag("--version", std::string(diagnostics::version),
                       "Print the version and exit");
  add_scenario(cli, options.scenario_path, options.overrides);
  add_lcm_url(cli, options.lcm_url);
  add_key_file(cli, given.key_path);
  cli.add_option("--wait-s", options.wait_s,
                 "Longest wait for the other programs at the start [s]; 0 = unlimited")
      ->check(CLI::Range(0.0, 1e6))
      ->capture_default_str();
  cli.add_option("--stats", given.stats_path, "Write counters to this file, as JSON, at the end");
  cli.add_flag("--spin", options.spin,
               "Do not sleep while waiting for messages: answers at once, and takes a CPU");
  add_role_options(cli, role, given);
  auto* quiet = cli.add_flag("-q,--quiet", given.quiet, "Warnings and errors only");
  cli.add_flag("-v,--verbose", given.verbose, "More detail on stderr")->excludes(quiet);
  // For `tachless run`, which tells the cause of an end from other lines by it; not in --help.
  cli.add_flag("--mark-levels", given.mark_levels)->group("");
}

std::filesystem::path default_log_path() {
  const std::time_t now = std::time(nullptr);
  std::tm date{};
  localtime_r(&now, &date);
  return next_log_path({}, date);
}

/// Nothing for an empty text.
template <class Value, class Raw>
std::optional<Value> if_given(const Raw& raw) {
  return raw == Raw() ? std::nullopt : std::optional<Value>(raw);
}

}  // namespace

std::string program_name(loop::Role role) { return program_of(role).name; }

std::filesystem::path next_log_path(const std::filesystem::path& directory, const std::tm& date) {
  for (int number = 0;; ++number) {
    std::filesystem::path path = directory / fmt::format("lcmlog-{:%Y-%m-%d}.{:02}", date, number);
    if (!std::filesystem::exists(path)) return path;
  }
}

std::optional<ProcessOptions> parse_process_options(loop::Role role, int argc,
                                                    const char* const* argv) {
  const std::string program = program_name(role);
  ProcessOptions options;
  options.lcm_url = default_lcm_url;
  Given given;
  CLI::App cli(program_of(role).task, program);
  add_options(cli, role, options, given);
  if (!parse(cli, argc, argv)) return std::nullopt;
  if (options.scenario_path.empty()) {
    throw bad_usage(fmt::format("SCENARIO: empty; name a YAML file; see {} --help", program));
  }
  if (!std::isfinite(options.wait_s)) {  // CLI::Range lets NaN through
    throw bad_usage("--wait-s: not a number; allowed: 0 (unlimited) to 1e6 s");
  }
  options.key_path = if_given<std::filesystem::path>(given.key_path);
  options.stats_path = if_given<std::filesystem::path>(given.stats_path);
  options.plant.run_id = if_given<std::int64_t>(given.run_id);
  options.controller.follow = if_given<std::int64_t>(given.follow);
  options.controller.resume = if_given<std::filesystem::path>(given.resume);
  if (given.serve >= 0) options.controller.serve = given.serve;
  if (options.controller.follow && options.key_path) {
    throw bad_usage(
        "--follow: what is played back does not verify under a key; unset --key-file and "
        "TACHLESS_KEY_FILE");
  }
  if (role == loop::Role::logger) {
    options.logger.log_path =
        given.log_path.empty() ? default_log_path() : std::filesystem::path(given.log_path);
  }
  if (given.quiet) options.verbosity = diagnostics::Verbosity::quiet;
  if (given.verbose) options.verbosity = diagnostics::Verbosity::verbose;
  if (given.mark_levels) options.marks = diagnostics::Marks::levels;
  return options;
}

int run_process(loop::Role role, int argc, const char* const* argv,
                const std::function<ExitCode(const ProcessOptions&)>& run) {
  diagnostics::start_logging(program_name(role), diagnostics::Verbosity::normal);
  try {
    const std::optional<ProcessOptions> options = parse_process_options(role, argc, argv);
    if (!options) return static_cast<int>(ExitCode::done);
    diagnostics::start_logging(program_name(role), options->verbosity, options->marks);
    return static_cast<int>(run(*options));
  } catch (const std::exception&) {
    return diagnostics::told_exception("the scenario and the options");
  }
}

}  // namespace tachless::node

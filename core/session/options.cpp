#include "session/options.h"

#include <fmt/chrono.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <exception>
#include <iostream>
#include <stdexcept>

#include "base/failure.h"
#include "base/this_process.h"
#include "base/version.h"

namespace tachless::session {
namespace {

namespace fs = std::filesystem;
using base::bad_usage;
using base::ExitCode;
using messages::Role;

constexpr std::int64_t largest_run_id = 9'000'000'000'000'000;

struct Program {
  const char* name;
  const char* task;
  const char* examples;  ///< in addition to the common examples; {0} is the program
};

const Program& program_of(Role role) {
  static constexpr std::array programs = {
      Program{"tachless-plant", "Simulates the robot of a scenario and keeps the loop's clock.",
              "  {0} scenarios/practical_rigid.yaml --run-id 7 --wait-s 10\n"},
      Program{"tachless-reference", "Generates the reference of a scenario, one tick ahead.", ""},
      Program{"tachless-controller", "Runs the control law of a scenario.",
              "  {0} scenarios/practical_rigid.yaml --wait-s 10\n"},
      Program{"tachless-logger", "Records the run of a scenario without a gap.",
              "  {0} scenarios/practical_rigid.yaml --out-log out/lcmlog\n"}};
  return programs.at(static_cast<std::size_t>(role));
}

std::string examples(const Program& program) {
  return fmt::format(
      "Examples:\n"
      "  {0} scenarios/paper_rigid.yaml\n"
      "  {0} scenarios/paper_rigid.yaml --set loop.duration_s=0.5 --lcm-url "
      "'udpm://239.255.76.67:7700?ttl=0'\n"
      "{1}"
      "The four programs tachless-plant, tachless-reference, tachless-controller and\n"
      "tachless-logger may start in any order and must be given the same scenario.\n"
      "Exit codes: 0 done, 1 a check failed, 2 bad usage or scenario, 3 a peer is lost,\n"
      "4 protocol violated, 5 protective stop, 130 interrupted.",
      program.name, fmt::format(fmt::runtime(program.examples), program.name));
}

void add_role_options(CLI::App& cli, Role role, ProcessOptions& options) {
  if (role == Role::plant) {
    as_run_id(cli.add_option("--run-id", options.run_id,
                             "Positive number in every message of the run; default: the time"));
  }
  if (role == Role::controller) {
    // For `tachless replay` and `tachless run --in-process`; hidden from --help.
    cli.add_option("--serve", options.serve)->group("");
  }
  if (role == Role::logger) {
    cli.add_option("--out-log", options.log_path,
                   "The log; default: lcmlog-YYYY-MM-DD.NN here, with the next free NN");
  }
}

void add_options(CLI::App& cli, Role role, ProcessOptions& options) {
  cli.footer(examples(program_of(role)));
  cli.set_version_flag("--version", std::string(base::version), "Print the version and exit");
  add_scenario(cli, options.scenario_path, options.overrides);
  add_lcm_url(cli, options.lcm_url);
  add_key_file(cli, options.key_path);
  cli.add_option("--wait-s", options.wait_s,
                 "Longest wait for the other programs at the start [s]; 0 = unlimited")
      ->check(CLI::Range(0.0, 1e6))
      ->capture_default_str();
  cli.add_option("--stats", options.stats_path, "Write counters to this file, as JSON, at the end");
  add_role_options(cli, role, options);
  auto* quiet = cli.add_flag_callback(
      "-q,--quiet", [&] { options.verbosity = base::Verbosity::quiet; },
      "Warnings and errors only");
  cli.add_flag_callback(
         "-v,--verbose", [&] { options.verbosity = base::Verbosity::verbose; },
         "More detail on stderr")
      ->excludes(quiet);
  // For `tachless run`, which recognises the cause of an end by the marks; hidden from --help.
  cli.add_flag_callback("--mark-levels", [&] { options.marks = base::Marks::levels; })->group("");
}

fs::path default_log_path() {
  const std::time_t now = std::time(nullptr);
  std::tm date{};
  localtime_r(&now, &date);
  return next_log_path({}, date);
}

}  // namespace

std::string find_scenario(const std::string& given) {
  std::error_code error;
  if (given.empty() || fs::exists(given, error)) return given;
  const fs::path folder = base::shared_directory() / "scenarios";
  fs::path name = given;
  if (*name.begin() == "scenarios") name = name.lexically_relative("scenarios");
  if (!name.has_extension()) name += ".yaml";
  const fs::path installed = folder / name;  // `given` itself, if that is absolute
  if (fs::exists(installed, error)) return installed.string();
  throw bad_usage("{}: no such file; looked for here and in {}", given, folder.string());
}

CLI::Option* with_installed_scenarios(CLI::Option* files) {
  return files->transform(find_scenario);
}

void add_overrides(CLI::App& command, std::vector<std::string>& overrides,
                   const std::string& does) {
  command.add_option("--set", overrides, does);
}

CLI::Option* add_scenario(CLI::App& command, fs::path& path, std::vector<std::string>& overrides) {
  add_overrides(command, overrides);
  return command.add_option("SCENARIO", path, "The experiment, a YAML file")->required();
}

void add_lcm_url(CLI::App& command, std::string& url) {
  command.add_option("--lcm-url", url, "The bus")
      ->envname("LCM_DEFAULT_URL")
      ->capture_default_str();
}

bus::LcmUrl parse_lcm_url(const std::string& url) {
  try {
    return bus::parse_lcm_url(url);
  } catch (const std::invalid_argument& problem) {
    throw bad_usage(problem.what());
  }
}

void add_key_file(CLI::App& command, std::string& path) {
  command
      .add_option("--key-file", path,
                  "Key of the bus, the same for all: 32 random bytes or 64 hexadecimal digits; "
                  "messages without it are ignored")
      ->envname("TACHLESS_KEY_FILE");
}

void take_whole_words(CLI::App& command) {
  for (CLI::Option* option : command.get_options()) {
    if (option->get_items_expected_max() == 0) continue;  // a flag
    if (!option->get_positional()) option->allow_extra_args(false);
    option->check([](const std::string& word) {
      return word.empty() ? "empty; give a value, or leave the option out" : std::string();
    });
  }
}

CLI::Option* as_run_id(CLI::Option* option) {
  return option->check(CLI::Range(std::int64_t{1}, largest_run_id));
}

std::int64_t run_id_at(std::chrono::system_clock::time_point time) {
  return std::clamp<std::int64_t>(time.time_since_epoch() / std::chrono::microseconds(1), 1,
                                  largest_run_id);
}

std::string program_name(Role role) { return program_of(role).name; }

fs::path next_log_path(const fs::path& directory, const std::tm& date) {
  for (int number = 0;; ++number) {
    fs::path path = directory / fmt::format("lcmlog-{:%Y-%m-%d}.{:02}", date, number);
    if (!fs::exists(path)) return path;
  }
}

std::optional<ProcessOptions> parse_process_options(Role role, int argc, const char* const* argv) {
  ProcessOptions options;
  options.lcm_url = default_lcm_url;
  CLI::App cli(program_of(role).task, program_name(role));
  add_options(cli, role, options);
  take_whole_words(cli);
  try {
    cli.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() != 0)
      throw bad_usage("{}; see {} --help", error.what(), cli.get_name());
    cli.exit(error, std::cout, std::cerr);
    return std::nullopt;
  }
  if (!std::isfinite(options.wait_s)) {  // CLI::Range lets NaN through
    throw bad_usage("--wait-s: not a number; allowed: 0 (unlimited) to 1e6 s");
  }
  if (role == Role::logger && options.log_path.empty()) options.log_path = default_log_path();
  return options;
}

int run_process(Role role, int argc, const char* const* argv,
                const std::function<ExitCode(const ProcessOptions&)>& run) {
  base::open_standard_streams();
  base::start_logging(program_name(role), base::Verbosity::normal);
  try {
    const std::optional<ProcessOptions> options = parse_process_options(role, argc, argv);
    if (!options) return static_cast<int>(ExitCode::done);
    base::start_logging(program_name(role), options->verbosity, options->marks);
    return static_cast<int>(run(*options));
  } catch (const std::exception&) {
    return base::told_exception("the scenario and the options");
  }
}

}  // namespace tachless::session

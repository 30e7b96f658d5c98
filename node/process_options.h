#pragma once

#include <cstdint>
#include <ctime>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "bus/wire.h"
#include "diagnostics/failure.h"
#include "diagnostics/logging.h"

/// The command line of the four programs.
namespace tachless::node {

struct PlantOptions {
  std::optional<std::int64_t> run_id;  ///< > 0
};

struct ControllerOptions {
  std::optional<std::int64_t> follow;           ///< the run that is played back
  std::optional<std::filesystem::path> resume;  ///< log of the run to take over in
  std::optional<int> serve;  ///< descriptor of the socket to answer on, without a bus
};

struct LoggerOptions {
  std::filesystem::path log_path;  ///< --out-log, else the next free default name
};

/// What all four have, and for each role that has more a struct of its own, which is as it is here
/// for the others.
struct ProcessOptions {
  std::filesystem::path scenario_path;
  std::vector<std::string> overrides;  ///< of --set, in order; for load_scenario
  std::string lcm_url;                 ///< --lcm-url, else LCM_DEFAULT_URL, else one host only
  std::optional<std::filesystem::path> key_path;  ///< --key-file, else TACHLESS_KEY_FILE
  bool spin = false;                              ///< does not sleep while it waits for messages
  double wait_s = 0;  ///< longest wait for the other processes at the start; 0 = unlimited
  std::optional<std::filesystem::path> stats_path;  ///< where counters go, as JSON, at the end
  diagnostics::Verbosity verbosity = diagnostics::Verbosity::normal;
  diagnostics::Marks marks = diagnostics::Marks::none;  ///< --mark-levels, for who reads the lines
  PlantOptions plant;
  ControllerOptions controller;
  LoggerOptions logger;
};

/// "tachless-plant", "tachless-reference", …
std::string program_name(loop::Role role);

/// Reads the command line of the program of `role`. Nothing when --help or --version was asked
/// for and has been answered on stdout.
/// @throw Failure(bad_usage), one line naming option, value and remedy.
std::optional<ProcessOptions> parse_process_options(loop::Role role, int argc,
                                                    const char* const* argv);

/// `directory`/lcmlog-YYYY-MM-DD.NN with the lowest NN that is not taken, as lcm-logger names its
/// logs.
std::filesystem::path next_log_path(const std::filesystem::path& directory, const std::tm& date);

/// The whole of a `main`: options, logging, then `run`. A Failure becomes its one line on stderr
/// and its exit code, as does what the system refuses (code 2); any other exception becomes one
/// line and exit code 4 (an internal error).
int run_process(loop::Role role, int argc, const char* const* argv,
                const std::function<diagnostics::ExitCode(const ProcessOptions&)>& run);

}  // namespace tachless::node

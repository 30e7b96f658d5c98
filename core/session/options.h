#pragma once

#include <chrono>
#include <cstdint>
#include <ctime>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "base/failure.h"
#include "base/logging.h"
#include "bus/lcm_url.h"
#include "messages/messages.h"

namespace CLI {  // NOLINT(readability-identifier-naming): the library's name
class App;
class Option;
}  // namespace CLI

/// Options of several programs and verbs, each declared once, and the command line of the four
/// programs.
namespace tachless::session {

/// Bus of this host alone.
inline constexpr const char* default_lcm_url = "udpm://239.255.76.67:7667?ttl=0";

/// Returns the path of a scenario or URDF file: `given` if it exists, else an installed file. An
/// installed file is given by its path in scenarios/, with or without "scenarios/" and ".yaml".
/// @throw Failure(bad_usage) naming both places if there is no such file
std::string find_scenario(const std::string& given);
/// Makes an option or argument accept installed files too.
/// @return the same option
CLI::Option* with_installed_scenarios(CLI::Option* files);

/// Adds --set for the values of scenarios.
void add_overrides(
    CLI::App& command, std::vector<std::string>& overrides,
    const std::string& does = "key.path=value, in place of the scenario's value; may be repeated");
/// Adds SCENARIO, and --set for its values.
/// @return the option SCENARIO
CLI::Option* add_scenario(CLI::App& command, std::filesystem::path& path,
                          std::vector<std::string>& overrides);

/// Adds --lcm-url, with LCM_DEFAULT_URL and then the present `url` as defaults.
void add_lcm_url(CLI::App& command, std::string& url);
/// Returns the parts of the URL.
/// @throw Failure(bad_usage) naming the URL, which may come from LCM_DEFAULT_URL
bus::LcmUrl parse_lcm_url(const std::string& url);

/// Adds --key-file, with TACHLESS_KEY_FILE as default; `path` stays empty without either.
void add_key_file(CLI::App& command, std::string& path);

/// Makes each option take one word and refuse an empty word. Call it when the command has all its
/// options.
void take_whole_words(CLI::App& command);

/// Makes an option accept a run's id: a positive number.
/// @return the same option
CLI::Option* as_run_id(CLI::Option* option);

/// Returns the microseconds from 1970 to `time` as a run id. A time without a valid id gives the
/// nearest valid one.
std::int64_t run_id_at(std::chrono::system_clock::time_point time);

/// Options of the four programs; options of one program name it.
struct ProcessOptions {
  std::filesystem::path scenario_path;
  std::vector<std::string> overrides;  ///< values of --set in order, for load_scenario
  std::string lcm_url;                 ///< --lcm-url, else LCM_DEFAULT_URL, else one host only
  std::string key_path;                ///< --key-file, else TACHLESS_KEY_FILE; empty: no key
  double wait_s = 0;       ///< longest wait for the other processes at the start; 0 = unlimited
  std::string stats_path;  ///< file for the counters, as JSON, at the end; empty: none
  base::Verbosity verbosity = base::Verbosity::normal;
  base::Marks marks = base::Marks::none;  ///< --mark-levels, for programs that read the lines
  std::optional<std::int64_t> run_id;     ///< plant: > 0
  std::optional<int> serve;  ///< controller: descriptor of the socket to answer on, without a bus
  std::filesystem::path log_path;  ///< logger: --out-log, else the next free default name
};

/// Returns "tachless-plant", "tachless-reference", …
std::string program_name(messages::Role role);

/// Reads the command line of the program of `role`. Answers --help and --version on stdout and then
/// returns nullopt.
/// @throw Failure(bad_usage), one line naming option, value and remedy.
std::optional<ProcessOptions> parse_process_options(messages::Role role, int argc,
                                                    const char* const* argv);

/// Returns `directory`/lcmlog-YYYY-MM-DD.NN with the lowest free NN, which is how lcm-logger names
/// its logs.
std::filesystem::path next_log_path(const std::filesystem::path& directory, const std::tm& date);

/// Implements `main` of a program: options, logging, then `run`. A Failure becomes one line on
/// stderr and its exit code. A refusal of the system becomes one line and code 2. Any other
/// exception becomes one line and code 4 (an internal error).
int run_process(messages::Role role, int argc, const char* const* argv,
                const std::function<base::ExitCode(const ProcessOptions&)>& run);

}  // namespace tachless::session

#pragma once

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

/// Options that several programs and verbs have, declared once, so that they are the same
/// everywhere; and the command line of the four programs.
namespace tachless::session {

inline constexpr const char* default_lcm_url = "udpm://239.255.76.67:7667?ttl=0";

/// The scenario or URDF file that is meant: `given` where there is one; else one of the
/// installation, by its path in scenarios/, with or without this word and .yaml.
/// @throw Failure(bad_usage) naming both places, when there is none
std::string find_scenario(const std::string& given);
/// For an option or argument with such files. @return the same option
CLI::Option* with_installed_scenarios(CLI::Option* files);

/// --set for the values of scenarios.
void add_overrides(
    CLI::App& command, std::vector<std::string>& overrides,
    const std::string& does = "key.path=value, in place of the scenario's value; may be repeated");
/// SCENARIO, and --set for its values. @return the first
CLI::Option* add_scenario(CLI::App& command, std::filesystem::path& path,
                          std::vector<std::string>& overrides);

/// --lcm-url, else LCM_DEFAULT_URL, else what `url` is before.
void add_lcm_url(CLI::App& command, std::string& url);
/// @throw Failure(bad_usage) naming the URL, which may be that of LCM_DEFAULT_URL
bus::LcmUrl parse_lcm_url(const std::string& url);

/// --key-file, else TACHLESS_KEY_FILE; empty when there is none.
void add_key_file(CLI::App& command, std::string& path);

/// For a command that has all its options: each takes one word, and no word may be empty.
void take_whole_words(CLI::App& command);

/// For an option that is a run's id: a positive number. @return the same option
CLI::Option* as_run_id(CLI::Option* option);

/// Returns the time since 1970 in microseconds as a run id. A clock that is set to a time without
/// a valid id gives the nearest valid one.
std::int64_t run_id_by_clock();

/// Options of the four programs; options of one program name it.
struct ProcessOptions {
  std::filesystem::path scenario_path;
  std::vector<std::string> overrides;  ///< of --set, in order; for load_scenario
  std::string lcm_url;                 ///< --lcm-url, else LCM_DEFAULT_URL, else one host only
  std::string key_path;                ///< --key-file, else TACHLESS_KEY_FILE; empty: none
  double wait_s = 0;       ///< longest wait for the other processes at the start; 0 = unlimited
  std::string stats_path;  ///< where counters go, as JSON, at the end; empty: nowhere
  base::Verbosity verbosity = base::Verbosity::normal;
  base::Marks marks = base::Marks::none;  ///< --mark-levels, for who reads the lines
  std::optional<std::int64_t> run_id;     ///< plant: > 0
  std::optional<int> serve;  ///< controller: descriptor of the socket to answer on, without a bus
  std::filesystem::path log_path;  ///< logger: --out-log, else the next free default name
};

/// "tachless-plant", "tachless-reference", …
std::string program_name(messages::Role role);

/// Reads the command line of the program of `role`. Nothing when --help or --version was asked
/// for and has been answered on stdout.
/// @throw Failure(bad_usage), one line naming option, value and remedy.
std::optional<ProcessOptions> parse_process_options(messages::Role role, int argc,
                                                    const char* const* argv);

/// `directory`/lcmlog-YYYY-MM-DD.NN with the lowest NN that is not taken, as lcm-logger names its
/// logs.
std::filesystem::path next_log_path(const std::filesystem::path& directory, const std::tm& date);

/// The whole of a `main`: options, logging, then `run`. A Failure becomes its one line on stderr
/// and its exit code, as does what the system refuses (code 2); any other exception becomes one
/// line and exit code 4 (an internal error).
int run_process(messages::Role role, int argc, const char* const* argv,
                const std::function<base::ExitCode(const ProcessOptions&)>& run);

}  // namespace tachless::session

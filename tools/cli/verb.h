#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "base/failure.h"
#include "base/quantities.h"

namespace CLI {  // NOLINT(readability-identifier-naming): the library's name
class App;
}  // namespace CLI

namespace tachless::scenario {
struct Scenario;
}  // namespace tachless::scenario

namespace tachless::cli {

/// One verb of the command. A new verb needs a line in verbs.inc. It also needs a `const Verb` in a
/// file in verb/, with the verb's name followed by `_verb`.
struct Verb {
  using Action = std::function<base::ExitCode()>;

  std::string_view name;      ///< name as typed
  std::string_view does;      ///< one line
  std::string_view examples;  ///< lines, shown at the end of its --help
  /// Declares the verb's options on `command`. Returns the action that runs the verb.
  Action (*declare)(CLI::App& command);
};

/// Makes a verb of `Type`, whose members are the options: `declare(CLI::App&)` declares them,
/// `run()` runs the verb and returns the exit code.
template <class Type>
constexpr Verb verb_of(std::string_view name, std::string_view does, std::string_view examples) {
  return {name, does, examples, [](CLI::App& command) -> Verb::Action {
            auto verb = std::make_shared<Type>();
            verb->declare(command);
            return [verb] { return verb->run(); };
          }};
}

/// Declares --json, for verbs that print the same facts either way, or --quiet, for verbs that
/// compute for long.
void add_json(CLI::App& command, bool& json);
void add_quiet(CLI::App& command, bool& quiet);

/// Checks an option's value: a number above 0.
std::string above_zero(const std::string& text);

/// Prints text for people. Names of files may contain control characters. Question marks replace
/// all control characters except line ends.
void print_text(std::string_view text);
/// Prints `text`, or with --json `all` including `text`.
void print(bool json, nlohmann::ordered_json all, const std::string& text);

/// Returns whether the name ends with .yaml or .yml.
bool is_yaml(const std::filesystem::path& file);

inline constexpr std::string_view write_remedy = "name another file with --write";
/// Refuse an output file that cannot be written, before the work begins. The first function also
/// refuses a name that does not end as a scenario's name does.
void require_scenario_writable(const std::filesystem::path& file, bool force);
void require_writable(const std::filesystem::path& file, bool force);
/// Makes a scenario's name from its file's name: replaces each forbidden character by _.
std::string scenario_name(const std::filesystem::path& file);
/// Returns the path of `file` for a scenario written to `output`: relative to `output`, or absolute
/// if there is none.
std::string path_from(const std::filesystem::path& output, const std::filesystem::path& file);
/// Returns the text for `output` of a scenario that was read from `input`. Its paths still name the
/// same files.
std::string text_for(const std::filesystem::path& output, const scenario::Scenario& scenario,
                     const std::filesystem::path& input);
/// Writes `input` with `overrides` and `changes` as `output`.
void write_scenario(const std::filesystem::path& input, std::vector<std::string> overrides,
                    const std::vector<std::string>& changes, const std::filesystem::path& output);

/// Checks that the scenario's law exists, and shows the warnings of its model.
/// @throw base::Failure(bad_usage) for an unknown law
void warn(const scenario::Scenario& scenario);
/// Returns one number for each joint. The option has one number for all joints, or one for each.
/// @throw base::Failure(bad_usage) for another count of numbers
Vector one_a_joint(std::string_view option, const std::vector<double>& given, int joints);
/// Returns the overrides that replace the scenario's law by a program's law. `overrides` are the
/// overrides of the command line.
std::vector<std::string> of_program(const std::filesystem::path& scenario,
                                    std::vector<std::string> overrides,
                                    const std::string& law_program);

#define TACHLESS_VERB(name) extern const Verb name##_verb;
#include "cli/verbs.inc"
#undef TACHLESS_VERB

}  // namespace tachless::cli

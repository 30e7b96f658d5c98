#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "base/failure.h"

namespace CLI {  // NOLINT(readability-identifier-naming): the library's name
class App;
}  // namespace CLI

namespace tachless::scenario {
struct Scenario;
}  // namespace tachless::scenario

namespace tachless::cli {

/// One verb of the command. To add one: a line in verbs.inc, and in a file in verb/ a `const Verb`
/// of that name with `_verb` behind it.
struct Verb {
  using Action = std::function<base::ExitCode()>;

  std::string_view name;      ///< as typed
  std::string_view does;      ///< one line
  std::string_view examples;  ///< lines, shown at the end of its --help
  /// Declares the verb's options on `command`; what it returns runs the verb once they are read.
  Action (*declare)(CLI::App& command);
};

/// The verb of `Type`, whose members are its options: `declare(CLI::App&)` declares them, `run()`
/// does with them what the verb does and returns the exit code.
template <class Type>
constexpr Verb verb_of(std::string_view name, std::string_view does, std::string_view examples) {
  return {name, does, examples, [](CLI::App& command) -> Verb::Action {
            auto verb = std::make_shared<Type>();
            verb->declare(command);
            return [verb] { return verb->run(); };
          }};
}

/// --json, for verbs that print the same facts either way; --quiet, for verbs that compute for
/// long.
void add_json(CLI::App& command, bool& json);
void add_quiet(CLI::App& command, bool& quiet);

/// A check of an option: a number above 0.
std::string above_zero(const std::string& text);

/// On stdout: `text`, or, with --json, `all` with `text` in it.
void print(bool json, nlohmann::ordered_json all, const std::string& text);

/// By its name, which ends with .yaml or .yml.
bool is_yaml(const std::filesystem::path& file);

inline constexpr std::string_view write_remedy = "name another file with --write";
/// For verbs that write a scenario: refuse, before the work, a name that is none, and a file that
/// could not or should not be written after it.
void require_scenario_writable(const std::filesystem::path& file, bool force);
void require_writable(const std::filesystem::path& file, bool force);
/// A scenario's name after its file: each character that is not allowed in one is _.
std::string scenario_name(const std::filesystem::path& file);
/// `file` as a scenario written as `output` names it: relative to that, absolute where there is
/// none.
std::string path_from(const std::filesystem::path& output, const std::filesystem::path& file);
/// The text of a scenario that was read from `input`, as `output` is to have it: the files that it
/// names stay where they are.
std::string text_for(const std::filesystem::path& output, const scenario::Scenario& scenario,
                     const std::filesystem::path& input);
/// Writes `input` with `overrides` and `changes` as `output`.
void write_scenario(const std::filesystem::path& input, std::vector<std::string> overrides,
                    const std::vector<std::string>& changes, const std::filesystem::path& output);

#define TACHLESS_VERB(name) extern const Verb name##_verb;
#include "cli/verbs.inc"
#undef TACHLESS_VERB

}  // namespace tachless::cli

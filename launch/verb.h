#pragma once

#include <functional>
#include <memory>
#include <string_view>

#include "diagnostics/failure.h"

namespace CLI {  // NOLINT(readability-identifier-naming): the library's name
class App;
}  // namespace CLI

namespace tachless::launch {

/// One verb of the command. To add one: a line in verbs.inc, and in a file in verb/ a `const Verb`
/// of that name with `_verb` behind it.
struct Verb {
  using Action = std::function<diagnostics::ExitCode()>;

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

#define TACHLESS_VERB(name) extern const Verb name##_verb;
#include "launch/verbs.inc"
#undef TACHLESS_VERB

}  // namespace tachless::launch

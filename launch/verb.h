#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <span>
#include <string_view>

#include "diagnostics/failure.h"

namespace tachless::launch {

/// One verb of the command. To add one: a line in verbs.inc, and a file in verb/ that defines a
/// `const Verb` of that name in the namespace `launch::verb`.
struct Verb {
  using Action = std::function<diagnostics::ExitCode()>;

  std::string_view name;      ///< as typed
  std::string_view does;      ///< one line
  std::string_view examples;  ///< lines, shown at the end of its --help
  /// Declares the verb's options on `command`; what it returns runs the verb once they are read.
  Action (*declare)(CLI::App& command);
};

/// For an option or argument with logs of runs: a directory stands for the log in it, `lcmlog`.
/// @return the same option
CLI::Option* with_directories(CLI::Option* logs);

/// In the order of --help.
std::span<const Verb* const> verbs();

}  // namespace tachless::launch

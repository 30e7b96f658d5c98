#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace tachless::launch {

/// The verbs of a command and their options with the values that they allow, as a script by which
/// the shell completes them. Where a value is not one of a set, it completes files.
std::string bash_completion(const CLI::App& tachless);
std::string zsh_completion(const CLI::App& tachless);

}  // namespace tachless::launch

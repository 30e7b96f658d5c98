// The `tachless` command: reads the command line, runs its verb, and turns a Failure into one line
// on stderr and its exit code.

#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <iostream>
#include <string>
#include <vector>

#include "diagnostics/failure.h"
#include "diagnostics/json_text.h"
#include "diagnostics/logging.h"
#include "diagnostics/text.h"
#include "diagnostics/version.h"
#include "launch/verb.h"
#include "node/options.h"
#include "process/this_process.h"

namespace tachless::launch {

void add_json(CLI::App& command, bool& json) { command.add_flag("--json", json, "As JSON"); }
void add_quiet(CLI::App& command, bool& quiet) {
  command.add_flag("-q,--quiet", quiet, "No progress on stderr");
}

std::string above_zero(const std::string& text) {
  const double number = diagnostics::number_in(text).value_or(0);
  return number > 0 && std::isfinite(number) ? "" : text + "; allowed: a number above 0";
}

void print(bool json, nlohmann::ordered_json all, const std::string& text) {
  all["text"] = text;
  std::cout << (json ? diagnostics::json_text(all, 2) + "\n" : text);
}

namespace {

/// In the order of --help.
constexpr std::array verbs = {
#define TACHLESS_VERB(name) &name##_verb,
#include "launch/verbs.inc"
#undef TACHLESS_VERB
};

constexpr const char* footer =
    "Examples:\n"
    "  tachless run scenarios/paper_rigid.yaml\n"
    "  tachless info out/paper_rigid\n"
    "  tachless doctor\n"
    "`tachless help VERB` explains a verb.\n"
    "Exit codes: 0 done, 1 a check failed, 2 bad usage or scenario, 3 a peer is lost,\n"
    "4 protocol violated, 5 protective stop, 130 interrupted.";

void require_verb(const std::string& word) {
  std::vector<std::string_view> names;
  names.reserve(verbs.size());
  for (const Verb* verb : verbs) names.push_back(verb->name);
  if (std::ranges::find(names, word) != names.end()) return;
  const auto meant = diagnostics::nearest(word, names);
  throw diagnostics::bad_usage("there is no verb '{}'{}; there are {}", word,
                               meant ? fmt::format("; did you mean {}?", *meant) : "",
                               diagnostics::joined(names));
}

diagnostics::ExitCode run(std::vector<const char*> words) {
  if (words.size() > 1 && words[1] == std::string_view("help")) {
    words.erase(words.begin() + 1);  // `help VERB` is `VERB --help`
    words.push_back("--help");
  }
  CLI::App cli("Robot joints tracked from positions alone.", "tachless");
  cli.footer(footer);
  cli.set_version_flag("-V,--version", fmt::format("tachless {}", diagnostics::version),
                       "Print the version and exit");
  cli.require_subcommand(1);
  diagnostics::ExitCode result = diagnostics::ExitCode::done;
  for (const Verb* verb : verbs) {
    CLI::App* command = cli.add_subcommand(std::string(verb->name), std::string(verb->does));
    command->footer(fmt::format("Examples:\n{}", verb->examples));
    command->callback([action = verb->declare(*command), &result] { result = action(); });
    node::take_whole_words(*command);
  }
  if (words.size() < 2) {
    std::cerr << cli.help();
    throw diagnostics::bad_usage("name a verb, for example: tachless doctor");
  }
  const std::string verb = words[1][0] == '-' ? "" : words[1];
  if (!verb.empty()) require_verb(verb);
  const auto refuse = [&](std::string_view why) {
    return diagnostics::bad_usage("{}{}{}; see tachless {}{}--help", verb, verb.empty() ? "" : ": ",
                                  why, verb, verb.empty() ? "" : " ");
  };
  try {
    cli.parse(static_cast<int>(words.size()), words.data());
  } catch (const diagnostics::Failure&) {
    // A mistyped option's value may have been taken for a file's name, which is refused first.
    if (cli.remaining_size(true) == 0) throw;
    throw refuse(CLI::ExtrasError(cli.remaining(true)).what());
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) {
      cli.exit(error, std::cout, std::cerr);
      return diagnostics::ExitCode::done;
    }
    throw refuse(error.what());
  }
  return result;
}

}  // namespace
}  // namespace tachless::launch

int main(int argc, char** argv) {
  using namespace tachless;
  diagnostics::start_logging("tachless", diagnostics::Verbosity::normal);
  process::survive_file_size_limit();
  try {
    const diagnostics::ExitCode code = launch::run({argv, argv + argc});
    pollfd closed{STDOUT_FILENO, 0, 0};  // or its reader has ended, as behind `| head -1`
    if (!std::cout.flush() && code == diagnostics::ExitCode::done && poll(&closed, 1, 0) == 0) {
      throw diagnostics::bad_usage(
          "standard output: cannot be written; free some space, or send it elsewhere");
    }
    return static_cast<int>(code);
  } catch (const std::exception&) {
    return diagnostics::told_exception("the command line");
  }
}

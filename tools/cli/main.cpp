// The `tachless` command: reads the command line, runs its verb, and turns a Failure into one line
// on stderr and its exit code.

#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <exception>
#include <iostream>
#include <string>
#include <vector>

#include "base/failure.h"
#include "base/logging.h"
#include "base/text.h"
#include "base/this_process.h"
#include "base/version.h"
#include "cli/verb.h"
#include "session/options.h"

namespace tachless::cli {

namespace {

/// In the order of --help.
constexpr std::array verbs = {
#define TACHLESS_VERB(name) &name##_verb,
#include "cli/verbs.inc"
#undef TACHLESS_VERB
};

constexpr const char* footer =
    "Examples:\n"
    "  tachless run scenarios/paper_rigid.yaml\n"
    "  tachless info out/paper_rigid\n"
    "  tachless doctor\n"
    "tachless help VERB explains a verb.\n"
    "Exit codes: 0 done, 1 a check failed, 2 bad usage or scenario, 3 a peer was lost,\n"
    "4 protocol violated, 5 protective stop, 130 interrupted.";

void require_verb(const std::string& word) {
  std::vector<std::string_view> names;
  names.reserve(verbs.size());
  for (const Verb* verb : verbs) names.push_back(verb->name);
  if (std::ranges::find(names, word) != names.end()) return;
  const auto meant = base::nearest(word, names);
  throw base::bad_usage("there is no verb '{}'{}; there are {}", word,
                        meant ? fmt::format("; did you mean {}?", *meant) : "",
                        base::joined(names));
}

base::ExitCode run(std::vector<const char*> words) {
  if (words.size() > 1 && words[1] == std::string_view("help")) {
    words.erase(words.begin() + 1);  // `help VERB` is `VERB --help`
    words.push_back("--help");
  }
  if (words.size() > 1 &&
      (words[1] == std::string_view("version") || words[1] == std::string_view("-v"))) {
    words[1] = "--version";
  }
  CLI::App cli("Robot joints tracked from positions alone.", "tachless");
  cli.footer(footer);
  cli.set_version_flag("-V,--version", fmt::format("tachless {}", base::version),
                       "Print the version and exit");
  cli.require_subcommand(1);
  base::ExitCode result = base::ExitCode::done;
  for (const Verb* verb : verbs) {
    CLI::App* command = cli.add_subcommand(std::string(verb->name), std::string(verb->does));
    command->footer(fmt::format("Examples:\n{}", verb->examples));
    command->callback([action = verb->declare(*command), &result] { result = action(); });
    session::take_whole_words(*command);
  }
  if (words.size() < 2) {
    std::cerr << cli.help();
    throw base::bad_usage("name a verb, for example: tachless doctor");
  }
  const std::string verb = words[1][0] == '-' ? "" : words[1];
  if (!verb.empty()) require_verb(verb);
  const auto refuse = [&](std::string_view why) {
    return base::bad_usage("{}{}{}; see tachless {}{}--help", verb, verb.empty() ? "" : ": ", why,
                           verb, verb.empty() ? "" : " ");
  };
  try {
    cli.parse(static_cast<int>(words.size()), words.data());
  } catch (const base::Failure&) {
    // A mistyped option's value may have been taken for a file's name, which is refused first.
    if (cli.remaining_size(true) == 0) throw;
    throw refuse(CLI::ExtrasError(cli.remaining(true)).what());
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) {
      cli.exit(error, std::cout, std::cerr);
      return base::ExitCode::done;
    }
    throw refuse(error.what());
  }
  return result;
}

}  // namespace
}  // namespace tachless::cli

int main(int argc, char** argv) {
  using namespace tachless;
  base::open_standard_streams();
  base::start_logging("tachless", base::Verbosity::normal);
  base::survive_file_size_limit();
  try {
    const base::ExitCode code = cli::run({argv, argv + argc});
    pollfd closed{STDOUT_FILENO, 0, 0};  // or its reader has ended, as behind `| head -1`
    if (!std::cout.flush() && code == base::ExitCode::done && poll(&closed, 1, 0) == 0) {
      throw base::bad_usage(
          "standard output: cannot be written; free some space, or send it elsewhere");
    }
    return static_cast<int>(code);
  } catch (const std::exception&) {
    return base::told_exception("the command line");
  }
}

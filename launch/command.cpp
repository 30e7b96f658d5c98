#include "launch/command.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <exception>
#include <filesystem>
#include <iostream>
#include <string>
#include <system_error>
#include <vector>

#include "diagnostics/failure.h"
#include "diagnostics/logging.h"
#include "diagnostics/text.h"
#include "diagnostics/version.h"
#include "launch/verb.h"
#include "process/interruption.h"

namespace tachless::launch {
namespace verb {
#define TACHLESS_VERB(name) extern const Verb name;
#include "launch/verbs.inc"
#undef TACHLESS_VERB
}  // namespace verb

std::span<const Verb* const> verbs() {
  static constexpr std::array list = {
#define TACHLESS_VERB(name) &verb::name,
#undef TACHLESS_VERB
  };
  return list;
}

CLI::Option* with_directories(CLI::Option* logs) {
  return logs->transform([](const std::string& path) {
    std::error_code error;
    return std::filesystem::is_directory(path, error)
               ? (std::filesystem::path(path) / "lcmlog").string()
               : path;
  });
}

namespace {

constexpr const char* footer =
    "Examples:\n"
    "  tachless run scenarios/paper_rigid.yaml\n"
    "  tachless info out/paper_rigid/lcmlog\n"
    "  tachless doctor\n"
    "`tachless help VERB` tells more.\n"
    "Exit codes: 0 done, 1 a check said no, 2 bad usage or scenario, 3 a peer is lost,\n"
    "4 protocol violated, 5 protective stop, 130 interrupted.";

void require_verb(const std::string& word) {
  std::vector<std::string_view> names;
  for (const Verb* verb : verbs()) names.push_back(verb->name);
  if (std::find(names.begin(), names.end(), word) != names.end()) return;
  const auto meant = diagnostics::nearest(word, names);
  throw diagnostics::bad_usage("there is no verb '{}'{}; there are {}", word,
                               meant ? fmt::format("; did you mean {}?", *meant) : "",
                               diagnostics::joined(names));
}

/// `help VERB` is `VERB --help`.
std::vector<const char*> words_of(int argc, const char* const* argv) {
  std::vector<const char*> words(argv, argv + argc);
  if (words.size() > 1 && words[1] == std::string_view("help")) {
    words.erase(words.begin() + 1);
    words.push_back("--help");
  }
  return words;
}

diagnostics::ExitCode run(const std::vector<const char*>& words) {
  CLI::App cli("Robot joints tracked from positions alone.", "tachless");
  cli.footer(footer);
  cli.set_version_flag("-V,--version", fmt::format("tachless {}", diagnostics::version),
                       "Print the version and exit");
  cli.require_subcommand(1);
  diagnostics::ExitCode result = diagnostics::ExitCode::done;
  for (const Verb* verb : verbs()) {
    CLI::App* command = cli.add_subcommand(std::string(verb->name), std::string(verb->does));
    command->footer(fmt::format("Examples:\n{}", verb->examples));
    command->callback([action = verb->declare(*command), &result] { result = action(); });
  }
  if (words.size() < 2) {
    std::cerr << cli.help();
    throw diagnostics::bad_usage("name a verb, for example: tachless doctor");
  }
  if (words[1][0] != '-') require_verb(words[1]);
  try {
    cli.parse(static_cast<int>(words.size()), words.data());
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) {
      cli.exit(error, std::cout, std::cerr);
      return diagnostics::ExitCode::done;
    }
    const std::string_view verb = words[1][0] == '-' ? "" : words[1];
    throw diagnostics::bad_usage("{}{}{}; see tachless {}{}--help", verb, verb.empty() ? "" : ": ",
                                 error.what(), verb, verb.empty() ? "" : " ");
  }
  return result;
}

}  // namespace

int tachless(int argc, const char* const* argv) {
  diagnostics::start_logging("tachless", diagnostics::Verbosity::normal);
  process::survive_file_size_limit();
  try {
    return static_cast<int>(run(words_of(argc, argv)));
  } catch (const std::exception&) {
    return diagnostics::told_exception("the command line");
  }
}

}  // namespace tachless::launch

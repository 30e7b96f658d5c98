#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "launch/verb.h"
#include "process/child.h"
#include "process/installation.h"

namespace tachless::launch::verb {
namespace {

struct Options {
  std::string preset;
  std::string label;
  std::vector<std::string> patterns;
};

// Building and testing need the source tree, so the script at its root does them.
diagnostics::ExitCode hand_over(const Options& options) {
  const std::filesystem::path script = process::shared_directory() / "tachless";
  if (!std::filesystem::exists(script)) {
    throw diagnostics::bad_usage(
        "test: the tests need the source tree, and this is an installed program; in a clone, type: "
        "./tachless test");
  }
  std::vector<std::string> words = {script.string(), "test"};
  if (!options.preset.empty()) words.push_back("--preset=" + options.preset);
  if (!options.label.empty()) words.push_back("--label=" + options.label);
  words.insert(words.end(), options.patterns.begin(), options.patterns.end());
  process::become(words, "run `./tachless test` in the source tree");
}

Verb::Action declare(CLI::App& command) {
  auto options = std::make_shared<Options>();
  command.add_option("PATTERN", options->patterns,
                     "Regular expressions: only tests whose name matches one of them");
  command
      .add_option("--preset", options->preset,
                  "Only this build; default: release, and when everything is tested the fast tests "
                  "under the sanitizers of asan-ubsan and tsan too")
      ->check(CLI::IsMember({"release", "dev", "asan-ubsan", "tsan"}));
  command.add_option("--label", options->label,
                     "Only tests with this label: a room (bus, launch, …), style, soak, fast");
  return [options] { return hand_over(*options); };
}

}  // namespace

extern const Verb test;
const Verb test = {"test", "Build and test everything, in a private network namespace",
                   "  tachless test\n"
                   "  tachless test --label launch\n"
                   "  tachless test --preset asan-ubsan test_bus\n"
                   "The last line says: N passed, M failed.",
                   declare};

}  // namespace tachless::launch::verb

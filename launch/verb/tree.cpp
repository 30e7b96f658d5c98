// The verbs that copy or build files: init, test.

#include <fmt/format.h>

#include <filesystem>
#include <iostream>
#include <string>
#include <system_error>
#include <vector>

#include "launch/verb.h"
#include "process/child.h"
#include "process/this_process.h"

namespace tachless::launch {
namespace {

namespace fs = std::filesystem;
using diagnostics::ExitCode;

struct Init {
  fs::path directory;

  void declare(CLI::App& command) {
    command.add_option("DIR", directory, "A new directory, or an empty one")->required();
  }

  [[nodiscard]] ExitCode run() const {
    std::error_code error;
    fs::create_directories(directory, error);
    if (error || !fs::is_directory(directory)) {
      refuse("cannot be made a directory" + (error ? ": " + error.message() : ""));
    }
    const bool empty = fs::is_empty(directory, error);
    if (error) refuse(error.message());
    if (!empty) refuse("is not empty");
    for (const auto& file : fs::directory_iterator(process::shared_directory() / "project")) {
      const fs::path copy = directory / file.path().filename();
      fs::copy_file(file.path(), copy, error);
      if (error) refuse(fmt::format("{}: {}", copy.string(), error.message()));
      std::cout << copy.string() << '\n';
    }
    std::cout << fmt::format("To begin: cd {} && tachless run arm.yaml\n", directory.string());
    return ExitCode::done;
  }

 private:
  [[noreturn]] void refuse(const std::string& why) const {
    throw diagnostics::bad_usage("init {}: {}; name another directory", directory.string(), why);
  }
};

// Building and testing need the source tree, so the script at its root does them.
struct Test {
  std::string preset, label;
  std::vector<std::string> patterns;

  void declare(CLI::App& command) {
    command.add_option("PATTERN", patterns,
                       "Regular expressions: only tests whose name matches one of them");
    command
        .add_option("--preset", preset,
                    "Only this build; default: release, and when everything is tested the fast "
                    "tests under the sanitizers of asan-ubsan and tsan too")
        ->check(CLI::IsMember({"release", "dev", "asan-ubsan", "tsan"}));
    command.add_option("--label", label,
                       "Only tests with this label: a room (bus, launch, …), style, soak, fast");
  }

  [[nodiscard]] ExitCode run() const {
    const fs::path script = process::shared_directory() / "tachless";
    if (!fs::exists(script)) {
      throw diagnostics::bad_usage(
          "test: the tests need the source tree, and this is an installed program; in a clone, "
          "type: ./tachless test");
    }
    std::vector<std::string> words = {script.string(), "test"};
    if (!preset.empty()) words.push_back("--preset=" + preset);
    if (!label.empty()) words.push_back("--label=" + label);
    words.insert(words.end(), patterns.begin(), patterns.end());
    process::become(words, "run `./tachless test` in the source tree");
  }
};

}  // namespace

const Verb init_verb = verb_of<Init>(
    "init", "A project to begin with: a robot, a scenario, what to type", "  tachless init my_arm");

const Verb test_verb =
    verb_of<Test>("test", "Build and test everything, in a private network namespace",
                  "  tachless test\n"
                  "  tachless test --label launch\n"
                  "  tachless test --preset asan-ubsan test_bus\n"
                  "The last line says: N passed, M failed.");

}  // namespace tachless::launch

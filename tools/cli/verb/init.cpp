// The verb that copies files: init.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <iostream>
#include <string>
#include <system_error>

#include "base/text.h"
#include "base/this_process.h"
#include "cli/verb.h"

namespace tachless::cli {
namespace {

namespace fs = std::filesystem;
using base::ExitCode;

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
    for (const auto& file : fs::directory_iterator(base::shared_directory() / "project")) {
      const fs::path copy = directory / file.path().filename();
      if (!fs::copy_file(file.path(), copy, error)) {
        const std::string why = fmt::format("{}: {}", copy.string(), error.message());
        for (const auto& made : fs::directory_iterator(directory)) fs::remove(made, error);
        refuse(why);
      }
      std::cout << base::printable(copy.string()) << '\n';
    }
    std::cout << fmt::format("To begin: cd {} && tachless run arm.yaml\n",
                             base::shell_word(directory.string()));
    return ExitCode::done;
  }

 private:
  [[noreturn]] void refuse(const std::string& why) const {
    throw base::bad_usage("init {}: {}; name another directory", directory.string(), why);
  }
};

}  // namespace

const Verb init_verb =
    verb_of<Init>("init", "Creates a project: a robot, a scenario, and a README with commands",
                  "  tachless init my_arm");

}  // namespace tachless::cli
